"""Cameras that turn while they expose: errors, and what they are claimed to be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from horizon_errors import BEYOND_NEES, fit_errors, nadir_sigma_deg
from tables import Options, Table, number, percentile, root_mean_square
from tqdm import tqdm

from horizon_sensor_ros.core.horizon_fix import Frame
from horizon_sensor_ros.core.horizon_sensor import HorizonSensor
from horizon_sensor_ros.sim.scene_sets import MOVING_SCENES, SMEARS_PX, moving_scene, set_m

COLUMNS = (
    "frames",
    "drawn",
    "refused",
    "nadir RMS",
    "median",
    "max",
    "median sigma",
    "NEES",
    "beyond 3 sigma",
)
NOTES = (
    "Set M: frames as in set B of a camera that turns about any axis while it exposes, by as much "
    "as moves the middle of the frame by so many pixels, and rolls besides; air: glow of 40 to "
    "130 DN above the limb. Truth is that of the middle of the exposure.",
    "nadir: angle to the true one, degrees; sigma: in its least certain direction. NEES: mean of "
    "the squared nadir error in the fit's own sigmas (2 is right); beyond 3 sigma: share of it "
    "above 11.8, which the normal law reaches in 0.27 % of all cases.",
)


@dataclass(frozen=True)
class _Moved:
    """One frame: what it shows, and error, sigma and NEES of its fix, NaN where it is refused."""

    scene: str
    smear_px: float
    error_deg: float = np.nan
    sigma_deg: float = np.nan
    nees: float = np.nan


def _row(name: str, frames: Sequence[_Moved]) -> tuple[str, ...]:
    fixed = [frame for frame in frames if np.isfinite(frame.nees)]
    error = [frame.error_deg for frame in fixed]
    nees = np.array([frame.nees for frame in fixed])
    return (
        name,
        str(len(frames)),
        str(len(frames) - len(fixed)),
        number(root_mean_square(error), 4),
        number(percentile(error, 50), 4),
        number(percentile(error, 100), 3),
        number(percentile([frame.sigma_deg for frame in fixed], 50), 4),
        number(float(nees.mean()) if fixed else np.nan, 1),
        f"{number(100.0 * float(np.mean(nees > BEYOND_NEES)) if fixed else np.nan, 1)} %",
    )


def run(options: Options) -> list[Table]:
    """Set M, by smear, by scene, and all of it."""
    n, sensor = options.frames, HorizonSensor()
    frames = []
    for i, case in enumerate(tqdm(set_m(n, options.seed), total=n, desc="Set M", unit="frame")):
        sensor.reset()
        fix = sensor.process(
            [Frame(view, seen.image) for view, seen in zip(case.views, case.frames, strict=True)]
        )
        if not fix.ok:
            frames.append(_Moved(*moving_scene(i)))
            continue
        truth = case.frames[0].truth
        errors = fit_errors(fix.fit, truth.nadir_base, truth.altitude_m)
        sigma = nadir_sigma_deg(fix.fit.cov_nadir_altitude[:3, :3])
        frames.append(_Moved(*moving_scene(i), errors.nadir_deg, sigma, errors.nees))
    rows = [
        *(_row(f"{px:g} px", [f for f in frames if f.smear_px == px]) for px in SMEARS_PX),
        *(_row(scene, [f for f in frames if f.scene == scene]) for scene in MOVING_SCENES),
        _row("all", frames),
    ]
    return [Table(f"Set M: motion during the exposure ({n})", COLUMNS, tuple(rows), NOTES)]
