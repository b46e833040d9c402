"""Integration in time: rules of fixed step, steps that adapt, events, and CVODES."""
