"""What recordings tell of the cameras, as parts by these names.

``self_calibration`` (how they are mounted), ``lens_blur`` (by how much lenses blur more in their
corners).
"""
