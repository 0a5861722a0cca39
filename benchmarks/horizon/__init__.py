"""Errors and times of horizon fixes, by the core alone, on simulated frames and shared ones.

Parts, for `run.py --only` by `horizon_` and these names: ``methods`` (sets A to E, beside the
published methods, of which ``sloped_step`` is one), ``scenes`` (shared scenes and photographs),
``hard`` (hard scenes of every kind), ``alone`` (their cameras one by one), ``figure`` (the
flattened Earth), ``sun`` (the Sun and no planet), ``motion`` (motion blur), ``readout`` (rolling
shutters), ``told`` (what frames cannot tell), ``timing``. ``paper_b`` and ``paper_c`` are those
papers' own cases, and parts by these names.

What they share: ``errors`` (of a fit against truth, and the bound), ``bags`` (of scenes, and their
replay).
"""
