"""Shadow: a model run beside its arm, with residuals of torque and position, and alarms with their cause."""
