"""Frames that are not of one moment, one by one or together, on a craft that swings: errors where
that is not known, and where it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from horizon.errors import BEYOND_NEES, fit_errors
from horizon_sensor_ros.core.aiding import Aiding
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.sim.earth_camera import SimFrame
from horizon_sensor_ros.sim.flight import Flight, swinging_flight
from tables import Options, Table, number, percentile, root_mean_square

COLUMNS = (
    "frames",
    "rates up to",
    "their times",
    "fixed",
    "nadir RMS",
    "max",
    "NEES",
    "beyond 3 sigma",
)
_PERIOD_S = 1.0 / 30.0
_RATES_DEG_S = (0.3, 1.0, 3.0, 10.0)


class _Times(NamedTuple):
    """What frames are like: readout, exposure, and by how much the second camera is late; and at
    which rates that matters.
    """

    readout_s: float = 0.0
    exposure_s: float = 0.0
    late_s: float = 0.0
    rates_deg_s: tuple[float, ...] = _RATES_DEG_S


_FRAMES = {
    "rolling shutter, 20 ms": _Times(readout_s=0.02),
    "15 ms apart": _Times(late_s=0.015),
    "exposed for 40 ms": _Times(exposure_s=0.04, rates_deg_s=_RATES_DEG_S[2:]),
}
_SETS = 12
_OF_FRAMES = 8  # flights a rate: one of so many frames of a set
_KNOWN = ("not known", "known, no gyro", "known, gyro")
NOTES = (
    "Two perpendicular cameras, 640 x 480, 300 to 800 km above clouds, noise 4 DN; roll and pitch "
    f"swing with periods of 8 s and less. The last of {_SETS} sets at {1.0 / _PERIOD_S:.0f} Hz. "
    "Rolling shutter: so long from the first row to the last; apart: the second camera is late; "
    "exposed: motion smears frames, 40 ms at 10 deg/s by 3 px. Truth is that of the first camera's "
    "stamp, or of the middle of the exposure.",
    "nadir: angle to the true one, degrees. NEES: mean of the squared nadir error in the fit's own "
    "sigmas (2 is right); beyond 3 sigma: share of it above 11.8.",
)


def _last_fix(
    flown: Flight, late_s: float, sets: Sequence[Sequence[SimFrame]], known: str
) -> HorizonFix:
    """Fix of the last set, with what is known of its frames' times."""
    told = known != _KNOWN[0]
    times = {"readout_s": flown.readout_s * told, "exposure_s": flown.exposure_s * told}
    views = [replace(view, **times) for view in flown.views]
    sensor = HorizonSensor()
    for step, frames in enumerate(sets):
        rate = flown.turn(step * _PERIOD_S, 1e-3) / 1e-3 if known == _KNOWN[2] else None
        aiding = Aiding(rate_base_rad_s=rate, since_last_s=_PERIOD_S if step else None)
        shown = zip(views, frames, (0.0, late_s * told), strict=True)
        fix = sensor.process(
            [Frame(v, frame.image, after_s) for v, frame, after_s in shown], aiding
        )
    return fix


def _flights(
    name: str, rate_deg_s: float, count: int, seed: int
) -> dict[str, list[tuple[float, float]]]:
    """Nadir's errors, degrees, and their NEES, by what is known."""
    like = _FRAMES[name]
    errors: dict[str, list[tuple[float, float]]] = {known: [] for known in _KNOWN}
    for i in tqdm(range(count), desc=f"{name}, {rate_deg_s:g} deg/s", unit="flight"):
        rng = np.random.default_rng([seed, i, 0x73])
        flown = swinging_flight(float(np.radians(rate_deg_s)), rng)
        flown = replace(flown, readout_s=like.readout_s, exposure_s=like.exposure_s)
        times = [step * _PERIOD_S for step in range(_SETS)]
        sets = [(flown.frames(at)[0], flown.frames(at + like.late_s)[1]) for at in times]
        truth = sets[-1][0].truth
        for known, found in errors.items():
            fix = _last_fix(flown, like.late_s, sets, known)
            if fix.ok:
                error = fit_errors(fix.fit, truth.nadir_base, truth.altitude_m)
                found.append((error.nadir_deg, error.nees))
    return errors


def run(options: Options) -> list[Table]:
    """One row a kind of frames, a rate, and what is known."""
    count = max(1, options.frames // _OF_FRAMES)
    rows = []
    for name, like in _FRAMES.items():
        for rate_deg_s in like.rates_deg_s:
            for known, found in _flights(name, rate_deg_s, count, options.seed).items():
                nadir, nees = np.array(found).reshape(-1, 2).T
                rows.append(
                    (
                        name,
                        f"{rate_deg_s:g} deg/s",
                        known,
                        f"{len(found)}/{count}",
                        number(root_mean_square(nadir), 4),
                        number(percentile(nadir, 100), 4),
                        number(float(np.mean(nees)) if found else np.nan, 1),
                        str(np.count_nonzero(nees > BEYOND_NEES)),
                    )
                )
    title = f"Frames that are not of one moment ({count} flights a row)"
    return [Table(title, COLUMNS, tuple(rows), NOTES)]
