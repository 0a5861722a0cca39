"""Clouds of more than the target: a wall, a floor or a second body that stays where it is."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from horizon_sensor_ros.core.mathematics.rigid import inverse_pose
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.registration import register
from horizon_sensor_ros.core.target_motion.target_view import target_view
from horizon_sensor_ros.sim.shapes import TriangleMesh, assembly, beam, box
from horizon_sensor_ros.sim.tof_camera import ToFCamera
from tables import Options, Table
from target.pairs import MESHES, errors_at, random_poses, random_rotation, unit
from target.sets import WRONG_CM, WRONG_DEG

_TARGETS = ("n5", "n1", "l_truss")
_BESIDE = ("wall behind", "floor below", "second body", "arm in front")


def _beside(kind: str, rng: np.random.Generator) -> TriangleMesh:
    if kind == "wall behind":
        lean = Rotation.from_rotvec(unit(rng) * rng.uniform(0, 0.1)).as_matrix()
        return box((6, 6, 0.02)).moved(lean, (0, 0, rng.uniform(6.4, 6.6)))
    if kind == "floor below":
        return box((6, 0.02, 6), (0, rng.uniform(0.9, 1.3), 5.3))
    if kind == "second body":
        place = (1.3 * rng.choice([-1, 1]), rng.uniform(-0.5, 0.5), rng.uniform(5.0, 5.6))
        return box((0.8, 0.8, 0.8)).moved(random_rotation(rng), place)
    tip = (rng.uniform(0.1, 0.7), rng.uniform(-0.5, 0.5), 4.2)
    return beam((1.8, rng.uniform(-0.5, 0.5), 2.0), tip, 0.12)


def run(options: Options) -> list[Table]:
    """Answers and refusals, a fifth of the pairs of the other tables each."""
    count = max(options.frames // 5, 1)
    camera = ToFCamera()
    rows = []
    for kind in tqdm(_BESIDE, desc="beside the target", unit="kind"):
        for name in _TARGETS:
            right = wrong = refused = 0
            for k in range(count):
                rng = np.random.default_rng([options.seed, k, len(name), len(kind)])
                poses, other = random_poses(rng), _beside(kind, rng)
                a, b = (
                    camera.scan(
                        assembly([MESHES[name].moved(pose[:3, :3], pose[:3, 3]), other]),
                        np.eye(4), rng,
                    ).points
                    for pose in poses
                )  # fmt: skip
                found = register(target_view(a), target_view(b))
                if found.status is not Status.OK:
                    refused += 1
                elif _is_right(found.pose_b_from_a, *poses):
                    right += 1
                else:
                    wrong += 1
            rows.append((kind, name, str(count), str(right), str(wrong), str(refused)))
    return [
        Table(
            "More than the target in the cloud",
            ("what stands still", "target", "pairs", "right", "wrong", "refused"),
            tuple(rows),
            (f"right: within {WRONG_DEG:g} deg and {WRONG_CM:g} cm at the target's place",),
        )
    ]


def _is_right(found: np.ndarray, before: np.ndarray, after: np.ndarray) -> bool:
    deg, cm = errors_at(found, after @ inverse_pose(before), before[:3, 3])
    return deg < WRONG_DEG and cm < WRONG_CM
