"""From messages to answers, with no node and no clock: live and offline alike.

Images: ``horizon_pipeline``, of ``pairing`` (frames to sets), ``aiding_sources`` with
``coarse_poses`` (what else is known) and the core; ``horizon_outputs`` (what is published).
Clouds: ``target_pipeline``.
"""
