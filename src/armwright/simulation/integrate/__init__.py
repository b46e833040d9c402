"""How time goes on: rules of fixed step, steps that adapt, events, and CVODES."""
