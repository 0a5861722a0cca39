"""The limb under air that glows above it.

``limb`` fits limb, glow and ground of one frame: ``sight`` (what is seen), ``model`` (what it
should look like) with ``air_profile``, ``brightness`` and ``ground``; ``glare``,
``twilight`` and ``fading`` are what disturbs it. ``points`` makes limb points of all frames' fits,
by ``one_sky`` together. ``contour`` is the fallback, where no fit holds. ``white_air`` tells what
overexposure leaves open.
"""
