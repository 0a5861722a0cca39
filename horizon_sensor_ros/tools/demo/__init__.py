"""A simulated flight past the real nodes: the command `horizon_demo`."""
