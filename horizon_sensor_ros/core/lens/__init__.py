"""Lenses: directions of light <-> places on the image plane at focal length 1.

``lens`` (what every one can do), ``perspective`` and ``equidistant`` (the models), ``one_to_one``
(how far off the axis they hold).
"""
