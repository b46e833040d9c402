"""Calls whose numbers are frozen, by room."""
