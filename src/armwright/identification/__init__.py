"""Identification: from logs of measurements to parameters with error bars. So far: logs, their checks and their preparation."""
