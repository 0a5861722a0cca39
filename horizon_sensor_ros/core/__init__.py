"""The algorithms: numpy, scipy and OpenCV only, nothing of ROS.

Start at ``horizon_sensor``, the whole chain: frames in, a ``horizon_fix`` out. It follows the limb
(``track``) or has it searched for (``horizon_search``, over whole frames); ``horizon_estimator``
makes a fix of limbs that were found. Whom to believe: ``judgement`` (a fit), ``agreement`` (of the
cameras), ``single_cameras`` (what each finds by itself), ``hidden_sky`` (a frame with a part of the
craft before the sky), ``doubts`` (about cameras that contradicted others), ``craft_fixed`` (a
limb that does not turn as the gyro says), ``leaps`` (where no craft comes so soon),
``repeated_images`` (frozen cameras), ``lost_rows`` (frames that are not whole), ``byte_order``
(pixels whose bytes are swapped).

The folders these use, in the order of the data: ``lens`` (rays to the image plane), ``limb`` (image
to limb points), ``fits`` (limb points to nadir and altitude), ``covariance`` (what else may be
wrong), ``airglow`` (by night).

What is told and known: ``horizon_config`` (once), ``aiding`` (with each set of frames), ``status``
(why there is an answer, or none). Cameras: ``camera``, ``camera_view`` (in its place), ``mask``,
``linear_light``, ``white_level``, ``derived_camera`` and of it ``stretched_camera``. The planet:
``planet``, ``planet_figure`` (an ellipsoid fitted as a sphere), ``limb_curve`` (where a cone's limb
runs in an image), ``limb_points`` (what was found of it). Motion: ``gyro``, ``gyro_trust``,
``turn_rate``, ``nadir_rate``, ``readout`` (rows and frames of different moments). Mathematics:
``attitude``, ``rigid``, ``robust``, ``symmetric3``.

Beside the horizon: ``target`` (point clouds to a target's motion), ``self_calibration`` (how the
cameras are mounted), ``applicability`` (where a mounting sees the horizon).
"""
