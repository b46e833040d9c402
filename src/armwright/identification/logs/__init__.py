"""Logs of measurements: files of any logger as joint signals in SI units, checked and prepared for fitting."""
