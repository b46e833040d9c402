"""Fits and their quality, for every room that compares a model with measurements."""
