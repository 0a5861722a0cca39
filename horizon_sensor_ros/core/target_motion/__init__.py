"""Motion of a target of unknown shape from point clouds.

Start at ``tracker`` (clouds in order of time to a track, each a ``target_fix``), then at
``registration`` (two clouds, each made a ``target_view``, to a motion). That takes these folders,
in the order of the data: ``ranges`` (cloud to an image of inverse depth), ``noise`` (how exact that
is), ``surfaces`` (what is in it), ``alignment`` (the motion between two views), ``judgement``
(whether to believe it).

The ``track`` of a target frame keeps each ``known_view``, and holds new ones against
``constant_velocity``. Clouds that took time pass through ``sweeps``. ``config``: parameters. Beside
these ``section_patterns``, paper D's method.
"""
