"""Errors and times of the target's motion, by the core alone, on simulated clouds.

The part `target` is ``bench``, which puts together the tables of ``paper`` (paper D's cases),
``sets`` (random pairs, beside other people's registrations: ``peers``), ``sequences`` (long ones)
and ``profile`` (where the time goes). Parts of their own, by `target_` and these names: ``claims``
(covariances on random bodies), ``beside`` (more than the target in the cloud), ``swept`` (lidars
that sweep). What all share: ``pairs`` (clouds with their exact motion, and errors of a motion).
"""
