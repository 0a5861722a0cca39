"""Cameras that turn while they expose: errors, and what they are claimed to be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from tqdm import tqdm

from horizon.errors import BEYOND_NEES, fit_errors, nadir_sigma_deg
from horizon_sensor_ros.core.aiding import NOTHING_KNOWN, Aiding
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.sim.scene_sets import (
    MOVING_SCENES,
    SMEARS_PX,
    SceneCase,
    moving_scene,
    set_m,
)
from tables import Options, Table, number, percentile, root_mean_square

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
_TITLES = {
    False: "Set M: motion during the exposure",
    True: "The same where exposure and rate are told",
}
_EXPOSURE_S = 0.01
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


def _fixed(case: SceneCase, told: bool) -> HorizonFix:
    """Fix of a frame. told : exposure and rate are."""
    views, aiding = list(case.views), NOTHING_KNOWN
    if told:
        views = [replace(view, exposure_s=_EXPOSURE_S) for view in views]
        aiding = Aiding(rate_base_rad_s=case.turn_base_rad / _EXPOSURE_S)
    shown = zip(views, case.frames, strict=True)
    return HorizonSensor().process([Frame(view, seen.image) for view, seen in shown], aiding)


def _moved(case: SceneCase, i: int, told: bool) -> _Moved:
    """What comes of frame i of set M."""
    fix = _fixed(case, told)
    if not fix.ok:
        return _Moved(*moving_scene(i))
    truth = case.frames[0].truth
    errors = fit_errors(fix.fit, truth.nadir_base, truth.altitude_m)
    sigma = nadir_sigma_deg(fix.fit.cov_nadir_altitude[:3, :3])
    return _Moved(*moving_scene(i), errors.nadir_deg, sigma, errors.nees)


def run(options: Options) -> list[Table]:
    """Set M, by smear, by scene, and all of it: as it is seen, and with what is told of motion."""
    n = options.frames
    seen: dict[bool, list[_Moved]] = {told: [] for told in _TITLES}
    for i, case in enumerate(tqdm(set_m(n, options.seed), total=n, desc="Set M", unit="frame")):
        for told, frames in seen.items():
            frames.append(_moved(case, i, told))
    return [_table(f"{title} ({n})", seen[told]) for told, title in _TITLES.items()]


def _table(title: str, frames: Sequence[_Moved]) -> Table:
    """One row a length of smear, one a kind of scene, and one of all."""
    rows = [
        *(_row(f"{px:g} px", [f for f in frames if f.smear_px == px]) for px in SMEARS_PX),
        *(_row(scene, [f for f in frames if f.scene == scene]) for scene in MOVING_SCENES),
        _row("all", frames),
    ]
    return Table(title, COLUMNS, tuple(rows), NOTES)
