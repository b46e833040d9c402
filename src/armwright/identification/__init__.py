"""Identification: parameters with error bars from logs of measurements, and a verdict on data that the fit did not use."""
