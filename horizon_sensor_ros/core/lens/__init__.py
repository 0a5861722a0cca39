"""Lenses: directions of light <-> places on the image plane at focal length 1."""
