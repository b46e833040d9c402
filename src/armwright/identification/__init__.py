"""Identification: from logs of measurements to parameters with error bars, and a verdict on data that was not used."""
