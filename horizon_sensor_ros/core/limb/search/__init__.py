"""Where in the frames of all cameras the limb is, to a few pixels.

``working_image`` (the reduced frame), ``candidates`` (edges beside space), ``selection`` (those
that agree on one disc), ``air_layer`` (or is it the night's airglow?) by ``columns`` (brightness
straight down from the edge), ``layer_light`` (how that fades), ``stars`` (what only a night's
exposure shows) and ``bare_edge`` (nothing glows between these and the edge); ``larger_disc`` (or is
it a moon's?); ``evenly`` (some of many).
"""
