"""Inputs of an arm over time: commands, references, wrenches, payloads, brakes."""
