"""Where the time of a registration goes."""

from __future__ import annotations

import cProfile
import pstats
import time
from pathlib import Path

import numpy as np

from horizon_sensor_ros.core.target_motion.registration import register
from horizon_sensor_ros.core.target_motion.target_view import target_view
from horizon_sensor_ros.sim.tof_camera import ToFCamera
from tables import Options, Table
from target.pairs import prior_near, random_pair

PAIRS = 30
_SHOWN_SHARE = 0.03


def profile_table(options: Options) -> Table:
    """Time of every function of the registration that takes a part worth naming."""
    camera = ToFCamera()
    rng = np.random.default_rng(options.seed)
    pairs = [
        random_pair("n5", np.random.default_rng([options.seed, k]), camera) for k in range(PAIRS)
    ]
    priors = [prior_near(pair, rng) for pair in pairs]
    rows = []
    for title, given in (("cold", [None] * PAIRS), ("prior", priors)):
        profile = cProfile.Profile(time.process_time)
        profile.enable()
        for pair, prior in zip(pairs, given, strict=True):
            register(target_view(pair.a.points), target_view(pair.b.points), None, prior)
        profile.disable()
        rows += _rows(title, pstats.Stats(profile))
    return Table(
        f"Where the time goes (N5, {PAIRS} pairs)",
        ("start", "function", "calls a pair", "ms a pair", "share"),
        tuple(rows),
        (
            "CPU time with all that a function calls, so that the shares add up to more than all; "
            "the profiler's own cost is in it",
        ),
    )


def _rows(title: str, stats: pstats.Stats) -> list[tuple[str, ...]]:
    ours = {
        (Path(file).stem, name): (calls, total)
        for (file, _, name), (_, calls, _, total, _) in stats.stats.items()  # type: ignore[attr-defined]
        if "target_motion" in Path(file).parts and not name.startswith("<")
    }
    whole = sum(
        total for (_, name), (_, total) in ours.items() if name in ("register", "target_view")
    )
    return [
        (
            title, f"{module}.{name}", f"{calls / PAIRS:.1f}", f"{1e3 * total / PAIRS:.2f}",
            f"{100 * total / whole:.0f} %",
        )
        for (module, name), (calls, total) in sorted(ours.items(), key=lambda item: -item[1][1])
        if total > _SHOWN_SHARE * whole
    ]  # fmt: skip
