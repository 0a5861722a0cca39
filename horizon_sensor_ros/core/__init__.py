"""The algorithms: numpy, scipy and OpenCV only, nothing of ROS.

Horizon: ``camera`` and ``lens`` (pixels to rays), ``limb`` (image to limb points), ``fits`` (limb
points to nadir and altitude), ``covariance`` (what else may be wrong), ``airglow`` (by night),
``judgement`` and ``agreement`` (whether to believe it). ``horizon_estimator`` runs these over limbs
that were found, ``horizon_search`` over whole frames, and ``horizon_sensor`` is the whole chain:
start there.
The planet: ``planet``, ``planet_figure`` (an ellipsoid fitted as a sphere). Point clouds:
``target``. The cameras' mounting: ``self_calibration``. Where a mounting sees the horizon:
``applicability``.
"""
