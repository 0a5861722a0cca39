"""A lidar that sweeps its field while the target turns: errors where its points tell when they were
measured, and where not.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from horizon_sensor_ros.core.mathematics.rigid import (
    inverse_pose,
    pose_matrix,
    rotation_from_vector,
    vector_from_rotation,
)
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.config import RegistrationConfig, TrackerConfig
from horizon_sensor_ros.core.target_motion.tracker import TargetTracker
from horizon_sensor_ros.sim.swept_scan import SweptScan, swept_scan
from horizon_sensor_ros.sim.tof_camera import ToFCamera
from tables import Options, Table, number
from target.pairs import BEYOND_NEES, MESHES, nees, random_rotation, unit

_CAMERA = ToFCamera(width=128, height=128, pixel_pitch_m=65e-6)
_TARGETS = ("n5", "winged_cylinder", "plate_with_dish", "l_truss")
_PERIOD_S, _CLOUDS = 0.2, 8
_RATES_DEG_S = (1.0, 5.0, 15.0, 30.0)
# Returns on no grid leave a turn less certain than is allowed by default.
_ALLOWED = RegistrationConfig(max_rotation_sigma_rad=np.radians(2.0), max_shift_sigma_m=0.05)
NOTES = (
    f"{_CLOUDS} clouds, {_CAMERA.width} x {_CAMERA.height}, each swept from its top to its bottom "
    f"in all of the {_PERIOD_S:g} s to the next one, 5 mm of noise, 5.3 m away; "
    f"{', '.join(_TARGETS)}. On no grid: as of a sensor that is rolled, otherwise in each cloud, "
    "and whose points are turned back; 2 deg and 5 cm allowed.",
    "of poses since the first cloud: turn off, deg, shift off, mm; NEES (6 is right); beyond 3 "
    f"sigma: above {number(BEYOND_NEES, 2)}.",
)


class _Error(NamedTuple):
    turn_deg: float
    shift_mm: float
    nees: float


def run(options: Options) -> list[Table]:
    """One row for each kind of cloud, rate, and what is told."""
    seeds = max(1, options.frames // 50)
    rows = []
    for rolled in (False, True):
        for rate in _RATES_DEG_S:
            found: dict[str, list[_Error]] = {"yes": [], "no": []}
            refused = dict.fromkeys(found, 0)
            name = "on no grid" if rolled else "on the sensor's grid"
            cases = [(target, seed) for target in _TARGETS for seed in range(seeds)]
            for target, seed in tqdm(cases, desc=f"{name}, {rate:g} deg/s", unit="track"):
                rng = np.random.default_rng([options.seed, seed, int(rate), len(target)])
                pose_at = _turning(rate, rng)
                clouds = [_cloud(target, pose_at, k, rolled, rng) for k in range(_CLOUDS)]
                for told in found:
                    errors = _tracked(clouds, pose_at, told == "yes", rolled)
                    found[told] += errors
                    refused[told] += _CLOUDS - 1 - len(errors)
            rows += [_row(name, rate, told, found[told], refused[told]) for told in found]
    columns = (
        "points", "deg/s", "times told", "poses", "refused", "turn median", "max",
        "shift median", "max", "NEES median", "beyond 3 sigma",
    )  # fmt: skip
    return [Table("Clouds that are swept", columns, tuple(rows), NOTES)]


def _turning(rate_deg_s: float, rng: np.random.Generator) -> Callable[[float], np.ndarray]:
    start, axis, drift = random_rotation(rng), unit(rng), 0.02 * unit(rng)

    def pose(time_s: float) -> np.ndarray:
        turn = rotation_from_vector(np.radians(rate_deg_s) * time_s * axis)
        return pose_matrix(turn @ start, np.array([0.0, 0.0, 5.3]) + drift * time_s)

    return pose


def _cloud(
    target: str,
    pose_at: Callable[[float], np.ndarray],
    index: int,
    rolled: bool,
    rng: np.random.Generator,
) -> SweptScan:
    roll_rad = rng.uniform(0.1, 0.5) if rolled else 0.0
    start_s = index * _PERIOD_S
    return swept_scan(_CAMERA, MESHES[target], pose_at, start_s, _PERIOD_S, rng, roll_rad=roll_rad)


def _tracked(
    clouds: list[SweptScan], pose_at: Callable[[float], np.ndarray], told: bool, rolled: bool
) -> list[_Error]:
    """Errors of the poses after the first one, of those that were found in its frame."""
    tracker = TargetTracker(TrackerConfig(_ALLOWED if rolled else RegistrationConfig()))
    errors = []
    frame = None
    for k, cloud in enumerate(clouds):
        fix = tracker.process(
            cloud.points, round(k * _PERIOD_S * 1e9), times_s=cloud.times_s if told else None
        )
        if fix.status is not Status.OK:
            continue
        pose, true = fix.pose_sensor_from_target, pose_at(k * _PERIOD_S)
        if fix.new_frame:
            frame = inverse_pose(true) @ pose
            continue
        true = true @ frame
        turn = vector_from_rotation(true[:3, :3] @ pose[:3, :3].T)
        errors.append(
            _Error(
                float(np.degrees(np.linalg.norm(turn))),
                1e3 * float(np.linalg.norm(true[:3, 3] - pose[:3, 3])),
                nees(pose, fix.covariance, pose[:3, 3], true),
            )
        )
    return errors


def _row(name: str, rate: float, told: str, errors: list[_Error], refused: int) -> tuple[str, ...]:
    head = (name, f"{rate:g}", told, str(len(errors)), str(refused))
    if not errors:
        return (*head, *["-"] * 6)
    turn, shift, squares = np.array(errors).T
    return (
        *head,
        number(float(np.median(turn)), 3), number(float(turn.max()), 2),
        number(float(np.median(shift)), 1), number(float(shift.max()), 1),
        number(float(np.median(squares)), 1), str(np.count_nonzero(squares > BEYOND_NEES)),
    )  # fmt: skip
