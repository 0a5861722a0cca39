"""Cameras: what a pixel looks at, and what its value says.

Rays: ``camera``, ``camera_view`` (in its place on the craft), ``derived_camera`` and of it
``stretched_camera``, ``readout`` (rows and frames of different moments). Pixels: ``mask`` (which
may be used), ``linear_light``, ``white_level``, ``byte_order`` (whose two bytes are swapped).
"""
