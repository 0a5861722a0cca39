"""What cloud and ground beside the limb do to its edge, and the likeliest place in spite of it.

``ground_texture`` (what brightness may do), ``grazing`` (ground that is brightest at the limb),
``depth`` (what a profile sees of it), ``along_limb`` (what textures do along it). ``kriging`` finds
the edge's place beside them, in ``stretches`` of limb, by ``kriging_tables`` (what solves these),
and ``fitted_limb`` the limb of such places.
"""
