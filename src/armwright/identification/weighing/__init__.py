"""Mass properties of a link by scale, supports and pendulum, with intervals, and the record with them."""
