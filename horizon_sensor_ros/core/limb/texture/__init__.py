"""What cloud and ground beside the limb do to its edge, and the likeliest place in spite of it.

``ground_texture`` (what brightness may do), ``depth`` (what a profile sees of it), ``kriging`` (the
edge's place beside it), ``kriged_limb`` and ``fitted_limb`` (the limb of these places).
"""
