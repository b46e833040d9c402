"""The arm with its drives as one system ẋ = f(x, u): its state, its flow, what is told of it, and how fast it is."""
