"""What cloud and ground beside the limb do to its edge, and the likeliest place in spite of it.

``ground_texture`` (what brightness may do), ``grazing`` (ground that is brightest at the limb),
``depth`` (what a profile sees of it), ``kriging`` (the edge's place beside it), ``fitted_limb``
(the limb of such places).
"""
