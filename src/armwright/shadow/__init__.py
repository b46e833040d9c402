"""A model that runs beside its arm: residuals of torque and position, alarms, and what caused them."""
