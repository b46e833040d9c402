"""A simulated arm, its controller or both as a Functional Mock-up Unit of FMI 3.0 or 2.0, for other simulation tools."""
