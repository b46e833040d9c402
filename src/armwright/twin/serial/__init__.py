"""Bus servos on a serial line: frames, registers and rules, the time that bytes take, a pseudo-terminal that answers."""
