"""From simultaneous frames to nadir and altitude, or the reason why not.

Start at ``sensor``, the whole chain. It follows the limb (``track``, ``nadir_rate``) or has it
searched for (``search``, over whole frames); ``estimator`` makes a ``fix`` of the limbs that were
found in a ``sighting``, with ``fit_errors`` in its covariance. What it is told once: ``config``.

Whom to believe: ``judgement`` (a fit), ``frame_doubts`` (what a frame says against its own limb),
``agreement`` (of the cameras), ``single_cameras`` (what each finds by itself), ``at_layer`` (a limb
that may be the edge of airglow), ``hidden_sky`` (a frame with a part of the craft before the sky),
``doubts`` (about cameras that contradicted others), ``craft_fixed`` (a limb that does not turn as
the gyro says), ``leaps`` (where no craft comes so soon), ``repeated_images`` (frozen cameras),
``lost_rows`` (frames that are not whole).
"""
