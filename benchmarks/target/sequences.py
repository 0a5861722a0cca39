"""Long sequences of tumbling targets: the tracker, and plain chaining beside it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from tqdm import tqdm

from horizon_sensor_ros.core.mathematics.rigid import inverse_pose
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.registration import register
from horizon_sensor_ros.core.target_motion.target_view import target_view
from horizon_sensor_ros.core.target_motion.tracker import TargetTracker
from horizon_sensor_ros.sim.tof_camera import ToFCamera
from tables import Options, Table, number, verdict
from target.pairs import MESHES, nees, timed, tumbling

COUNT, RATE_HZ = 200, 5.0


def sequence_table(options: Options, targets: Sequence[str]) -> Table:
    """200 clouds at 5 Hz of tumbling targets: the tracker, and plain chaining beside it."""
    rows = []
    for target in targets:
        for rate in (3.0, 10.0):
            for seed in range(2 if options.frames >= 100 else 1):
                rows.append(_sequence(target, rate, options.seed + seed))
    return Table(
        "Sequences of 200 clouds at 5 Hz",
        ("target", "deg/s", "refused", "new frames", "keyframes", "end: deg, cm", "worst: deg, cm",
         "chained: deg, cm", "NEES pose, delta", "ms a cloud", "lost", "0.5 deg", "1 cm"),
        tuple(rows),
        ("errors since the target frame was set; chained: each cloud against the one before",
         "lost: target frames that had to be set after the first",),
    )  # fmt: skip


def _sequence(target: str, rate: float, seed: int) -> tuple[str, ...]:
    rng = np.random.default_rng([seed, int(rate)])
    poses = tumbling(rate, COUNT, RATE_HZ, rng)
    camera, tracker = ToFCamera(), TargetTracker()
    found: list[tuple[float, float]] = []
    refused = frames = 0
    seconds, pose_nees, delta_nees = [], [], []
    frame = chained = before = previous = None
    for k, pose in enumerate(tqdm(poses, desc=f"{target}, {rate:g} deg/s", unit="cloud")):
        cloud = camera.scan(MESHES[target], pose, rng).points
        fix, spent = timed(partial(tracker.process, cloud, round(k * 1e9 / RATE_HZ)))
        seconds.append(spent)
        if fix.status is not Status.OK:
            refused += 1
            continue
        frames += fix.new_frame
        view = target_view(cloud)
        if fix.new_frame:
            frame = inverse_pose(pose) @ fix.pose_sensor_from_target
            chained = fix.pose_sensor_from_target
        else:
            step = register(previous, view)
            chained = step.pose_b_from_a @ chained
        truth = pose @ frame
        pose_nees.append(_pose_nees(fix.pose_sensor_from_target, fix.covariance, truth))
        found.append(_pose_errors(fix.pose_sensor_from_target, truth))
        if fix.delta_previous_from_now is not None:
            delta_nees.append(
                _pose_nees(
                    fix.delta_previous_from_now, fix.delta_covariance, inverse_pose(before) @ truth
                )
            )
        before, previous = truth, view
    end, worst = found[-1], np.max(found, axis=0)
    loose = _pose_errors(chained, before)
    return (
        target, f"{rate:g}", str(refused), str(frames), str(fix.num_keyframes),
        f"{end[0]:.3f} {end[1]:.3f}", f"{worst[0]:.3f} {worst[1]:.3f}",
        f"{number(loose[0], 3)} {number(loose[1], 3)}",
        f"{np.median(pose_nees):.1f} {np.median(delta_nees):.1f}",
        f"{1e3 * np.median(seconds):.1f}",
        verdict(frames - 1, 0), verdict(end[0], 0.5), verdict(end[1], 1.0),
    )  # fmt: skip


def _pose_errors(found: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    angle = np.arccos(np.clip((np.trace(found[:3, :3].T @ truth[:3, :3]) - 1) / 2, -1, 1))
    return float(np.degrees(angle)), float(100 * np.linalg.norm(found[:3, 3] - truth[:3, 3]))


def _pose_nees(found: np.ndarray, covariance: np.ndarray, truth: np.ndarray) -> float:
    return nees(found, covariance, found[:3, 3], truth)
