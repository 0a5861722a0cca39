"""The limb under air that glows above it.

``fit`` fits limb, glow and ground of one frame: ``sight`` (what is seen, without ``glare``),
``first_guess`` (of the air), ``model`` (what it should look like, and the next step) with
``air_profile``, ``brightness`` and ``ground``, ``stride`` (how much of that step), ``limb`` (what
comes of it); ``twilight`` and ``fading`` are what disturbs it. ``points`` makes limb points of all
frames' fits, by ``one_sky`` together. ``contour`` is the fallback, where no fit holds.
``white_air`` tells what overexposure leaves open.
"""
