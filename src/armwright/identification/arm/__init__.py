"""Parameters of an arm from logs of its motion: base parameters, physically possible ones, payloads, friction."""
