"""The controller of a simulated loop as C99 for a microcontroller, with tests that compare it with the simulation."""
