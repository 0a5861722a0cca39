"""Self-calibration: the cameras' mounting from the horizons that they saw at many moments.

``measurement`` (what each camera saw), ``unknowns`` (what is to be found), ``normal_equations``
(the model), ``adjustment`` (the estimate), ``lens_check`` (whether the lenses allow one),
``corner_blur`` (how these blur in the corners), ``result``, ``observability`` (what it cannot tell,
in words), ``differences`` (how far the cameras' nadirs lie apart).
"""
