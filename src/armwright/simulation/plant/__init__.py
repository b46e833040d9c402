"""The arm with its drives as one system ẋ = f(x, u): state, derivative, outputs, and time constants."""
