"""Logs of measurements: what loggers wrote, as signals of joints in SI units, checked and prepared for fitting."""
