"""Plausibility checks: physical feasibility, units, mass properties, shapes, densities."""
