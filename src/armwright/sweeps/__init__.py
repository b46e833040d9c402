"""Sweeps: simulations of more lanes than fit one process, in chunks that are stored as they finish."""
