"""The algorithms: numpy, scipy and OpenCV only, nothing of ROS.

Start at ``horizon``: frames in, a fix out, by these folders, in the order of the data: ``cameras``
(pixels to rays), ``lens`` (rays to the image plane), ``limb`` (image to limb points), ``fits``
(limb points to nadir and altitude), ``covariance`` (what else may be wrong), ``airglow`` (by
night).

What these share: ``aiding`` (what is known with each set of frames), ``status`` (why there is an
answer, or none), ``planet``, ``planet_figure`` (an ellipsoid fitted as a sphere), ``limb_curve``
(where a cone's limb runs in an image), ``limb_points`` (what was found of it); ``motion`` (how the
craft turns), ``seconds`` (from nanoseconds, and back), ``mathematics``.

Beside the horizon: ``target_motion`` (point clouds to a target's motion), ``self_calibration`` (how
the cameras are mounted), ``applicability`` (where a mounting sees the horizon).
"""
