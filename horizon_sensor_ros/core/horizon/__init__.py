"""From simultaneous frames to nadir and altitude, or the reason why not.

Start at ``sensor``, the whole chain. It follows the limb (``track``, ``nadir_rate``) or has it
searched for (``search``, over whole frames); ``estimator`` makes a ``fix`` of limbs that were
found. What it is told once: ``config``.

Whom to believe: ``judgement`` (a fit), ``agreement`` (of the cameras), ``single_cameras`` (what
each finds by itself), ``hidden_sky`` (a frame with a part of the craft before the sky), ``doubts``
(about cameras that contradicted others), ``craft_fixed`` (a limb that does not turn as the gyro
says), ``leaps`` (where no craft comes so soon), ``repeated_images`` (frozen cameras), ``lost_rows``
(frames that are not whole).
"""
