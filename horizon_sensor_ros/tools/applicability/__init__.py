"""Where a horizon sensor works for given cameras: the command `horizon_applicability`.

``applicability`` (the command), ``arguments``, ``idle_options``, ``modes`` (what can be asked).
Computed: ``quality_map``, ``mounting_angle``, both of ``expected_sigma``; ``figure6`` (paper A's).
Written: ``figures``, ``table``.
"""
