"""Pose of a target of unknown shape from point clouds.

The default: ``range_image`` (any cloud as an image of inverse depth; with ``regular``,
``pixel_values`` and ``holes``), ``range_noise``, ``smoothed_noise``, ``repeated_returns``,
``common_noise`` and ``mixed_differences`` (how exact it is), ``planes``, those of thin ``parts``,
``edges`` and ``surfels`` (what is in it), ``search``, ``pairs``, ``refinement`` and ``attempts``
(motion between two views), ``consistency``, ``one_body``, ``layers``, ``alternatives`` and
``judgement`` (whether to believe it), ``registration`` (all of it), ``tracker`` (clouds in order of
time), ``temporal_filter`` (whether they hold parts of each other); ``config`` (their parameters),
``columns`` (products of many vectors).

Paper D: ``inertia_frame``, ``section_pattern``, ``direct_search``.
"""
