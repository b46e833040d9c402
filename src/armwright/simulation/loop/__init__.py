"""What happens in a tick: measure, decide, shape, delay."""
