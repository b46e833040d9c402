"""Validation: predictions of a record against a log, their measures, the verdict and its report."""
