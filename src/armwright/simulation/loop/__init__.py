"""The stages of a tick: measure, reference, control, filter, delay."""
