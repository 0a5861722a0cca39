"""Rolling shutters on a craft that swings: errors where they are not known of, and where they
are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from horizon_errors import BEYOND_NEES, fit_errors
from tables import Options, Table, number, percentile, root_mean_square
from tqdm import tqdm

from horizon_sensor_ros.core.aiding import Aiding
from horizon_sensor_ros.core.horizon_fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon_sensor import HorizonSensor
from horizon_sensor_ros.sim.earth_camera import SimFrame
from horizon_sensor_ros.sim.flight import Flight, swinging_flight

COLUMNS = ("rates up to", "readout", "fixed", "nadir RMS", "max", "NEES", "beyond 3 sigma")
_RATES_DEG_S = (0.3, 1.0, 3.0, 10.0)
_READOUT_S, _PERIOD_S = 0.02, 1.0 / 30.0
_SETS = 12
_OF_FRAMES = 8  # flights a rate: one of so many frames of a set
_KNOWN = ("not known", "known, no gyro", "known, gyro")
NOTES = (
    f"Two perpendicular cameras, 640 x 480, {_READOUT_S * 1e3:.0f} ms from the first row to the "
    "last, 300 to 800 km above clouds, noise 4 DN; roll and pitch swing with periods of "
    "8 s and less. The last of {_SETS} sets at {1.0 / _PERIOD_S:.0f} Hz. Truth is "
    "that of the stamp.",
    "nadir: angle to the true one, degrees. NEES: mean of the squared nadir error in the fit's own "
    "sigmas (2 is right); beyond 3 sigma: share of it above 11.8.",
)


def _last_fix(flown: Flight, sets: Sequence[Sequence[SimFrame]], known: str) -> HorizonFix:
    """Fix of the last set, with what is known of the readout."""
    readout_s = 0.0 if known == _KNOWN[0] else _READOUT_S
    views = [replace(view, readout_s=readout_s) for view in flown.views]
    sensor = HorizonSensor()
    for step, frames in enumerate(sets):
        rate = flown.turn(step * _PERIOD_S, 1e-3) / 1e-3 if known == _KNOWN[2] else None
        aiding = Aiding(rate_base_rad_s=rate, since_last_s=_PERIOD_S if step else None)
        shown = [Frame(view, frame.image) for view, frame in zip(views, frames, strict=True)]
        fix = sensor.process(shown, aiding)
    return fix


def run(options: Options) -> list[Table]:
    """One row a rate, and what is known of the readout."""
    count = max(1, options.frames // _OF_FRAMES)
    rows = []
    for rate_deg_s in _RATES_DEG_S:
        errors: dict[str, list[tuple[float, float]]] = {known: [] for known in _KNOWN}
        for i in tqdm(range(count), desc=f"{rate_deg_s:g} deg/s", unit="flight"):
            rng = np.random.default_rng([options.seed, i, 0x73])
            flown = swinging_flight(float(np.radians(rate_deg_s)), _READOUT_S, rng)
            sets = [flown.frames(step * _PERIOD_S) for step in range(_SETS)]
            truth = sets[-1][0].truth
            for known, found in errors.items():
                fix = _last_fix(flown, sets, known)
                if fix.ok:
                    error = fit_errors(fix.fit, truth.nadir_base, truth.altitude_m)
                    found.append((error.nadir_deg, error.nees))
        for known, found in errors.items():
            nadir, nees = np.array(found).reshape(-1, 2).T
            rows.append(
                (
                    f"{rate_deg_s:g} deg/s",
                    known,
                    f"{len(found)}/{count}",
                    number(root_mean_square(nadir), 4),
                    number(percentile(nadir, 100), 4),
                    number(float(np.mean(nees)) if found else np.nan, 1),
                    str(np.count_nonzero(nees > BEYOND_NEES)),
                )
            )
    return [Table(f"Rolling shutters ({count} flights a rate)", COLUMNS, tuple(rows), NOTES)]
