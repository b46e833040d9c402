"""What acts on an arm over time: commands, references, wrenches, payloads, brakes."""
