"""Each camera of the hard scenes by itself: one limb, often short, and nobody to contradict it."""

from __future__ import annotations

import numpy as np
from tqdm import tqdm

from horizon.errors import BEYOND_NEES, FitErrors, fit_errors, nadir_sigma_deg
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.sim.hard_kinds import ALL_KINDS
from horizon_sensor_ros.sim.hard_scenes import hard_scenes
from tables import Options, Table, number, percentile

_COLUMNS = (
    "kind",
    "limbs",
    "fixed",
    "median, deg",
    "95 %, deg",
    "max, deg",
    "over 3 sigma",
    "NEES",
)


def run(options: Options) -> list[Table]:
    """One row a kind, and all of them."""
    limbs = dict.fromkeys(ALL_KINDS, 0)
    fixes: dict[str, list[FitErrors]] = {kind: [] for kind in ALL_KINDS}
    sigmas_deg = []
    scenes = hard_scenes(options.hard_scenes, options.seed, options.kinds)
    for scene in tqdm(scenes, total=options.hard_scenes, desc="Cameras alone", unit="scene"):
        sensor = HorizonSensor(HorizonConfig(planet=scene.scene.planet, tracking=False))
        for view, frame in zip(scene.views, scene.frames, strict=True):
            if view.name not in scene.limb_cameras:
                continue
            limbs[scene.kind] += 1
            found = sensor.process([Frame(view, frame.image)])
            if found.ok:
                truth = frame.truth
                fixes[scene.kind].append(fit_errors(found.fit, truth.nadir_base, truth.altitude_m))
                sigmas_deg.append(nadir_sigma_deg(found.fit.cov_nadir_altitude[:3, :3]))
    rows = [_row(kind, limbs[kind], fixes[kind]) for kind in ALL_KINDS if limbs[kind]]
    every = [fix for some in fixes.values() for fix in some]
    rows.append(_row("all", sum(limbs.values()), every))
    notes = (
        "As `horizon_hard`, but every camera that shows 200 px of lit limb or more is given to the "
        "sensor without the other one. over 3 sigma: fixes whose squared error in sigmas is above "
        f"{number(BEYOND_NEES, 2)} (0.3 % by the normal law). NEES: its mean, 2 is right.",
        f"Nadir's sigma, as claimed, in its least certain direction: median "
        f"{number(percentile(sigmas_deg, 50), 3)} deg.",
    )
    title = f"One camera alone, hard scenes ({options.hard_scenes})"
    return [Table(title, _COLUMNS, tuple(rows), notes)]


def _row(kind: str, limbs: int, fixes: list[FitErrors]) -> tuple[str, ...]:
    errors_deg = [fix.nadir_deg for fix in fixes]
    nees = [fix.nees for fix in fixes]
    return (
        kind,
        str(limbs),
        str(len(fixes)),
        *(number(percentile(errors_deg, percent), 4) for percent in (50, 95, 100)),
        str(sum(value > BEYOND_NEES for value in nees)),
        number(float(np.mean(nees)) if nees else np.nan, 1),
    )
