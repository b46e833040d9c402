"""Sweeps: more simulations than one machine or one sitting can do, in chunks of lanes that are stored as they finish."""
