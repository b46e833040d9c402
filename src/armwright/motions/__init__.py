"""Motion files: an arm, its limits and segments, planned one after the other."""
