"""Sampled simulation of an arm with its motors."""
