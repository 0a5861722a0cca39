"""Where a horizon sensor works for given cameras: the command `horizon_applicability`."""
