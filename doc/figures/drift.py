"""Drift of a long sequence: the tracker with its kept views, and each cloud against the last."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from figures.drawing import BLUE, ORANGE, save
from horizon_sensor_ros.core.mathematics.rigid import inverse_pose, vector_from_rotation
from horizon_sensor_ros.core.target_motion.registration import register
from horizon_sensor_ros.core.target_motion.target_view import target_view
from horizon_sensor_ros.core.target_motion.tracker import TargetTracker
from horizon_sensor_ros.sim.shapes import TriangleMesh, plate_with_dish, sich_n5
from horizon_sensor_ros.sim.tumbling import TumblingTarget

_COUNT, _STEP_S = 200, 0.2


def draw(folder: Path) -> None:
    """Write drift.png: errors since the target frame was set, 40 s at 3 deg/s, of two targets."""
    figure, axes = plt.subplots(2, 2, figsize=(6.5, 4.4), sharex=True, layout="constrained")
    for column, (name, mesh) in enumerate((("N5", sich_n5()), ("plate", plate_with_dish()))):
        times, tracked, chained = _flown(mesh)
        axes[0, column].set_title(name, fontsize=11)
        axes[1, column].set_xlabel("time, s")
        for row in range(2):
            ax = axes[row, column]
            ax.plot(times, chained[row], color=ORANGE, label="chained")
            ax.plot(times, tracked[row], color=BLUE, label="kept views")
            ax.set_ylim(bottom=0.0)
            ax.grid(alpha=0.3)
    axes[0, 0].set_ylabel("turn, deg")
    axes[1, 0].set_ylabel("shift, cm")
    axes[0, 1].legend(loc="upper left")
    save(figure, folder / "drift.png")


def _flown(mesh: TriangleMesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (N,), and errors (2, N), deg and cm, of the tracker and of chaining."""
    target = TumblingTarget(
        mesh=mesh, precession_rad_s=np.radians(3.0), spin_rad_s=0.0, velocity_m_s=(0.0, 0.0, 0.004)
    )
    tracker, tracked, chained = TargetTracker(), [], []
    times = np.arange(_COUNT) * _STEP_S
    last = pose = frame = None
    for time_s in times:
        scan = target.scan(time_s)
        fix, view = tracker.process(scan.points, round(time_s * 1e9)), target_view(scan.points)
        if frame is None:
            pose = fix.pose_sensor_from_target
            frame = inverse_pose(scan.pose_cam_from_target) @ pose
        else:
            pose = register(last, view).pose_b_from_a @ pose
        truth, last = scan.pose_cam_from_target @ frame, view
        tracked.append(_errors(fix.pose_sensor_from_target, truth))
        chained.append(_errors(pose, truth))
    return times, np.array(tracked).T, np.array(chained).T


def _errors(found: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    turn = np.degrees(np.linalg.norm(vector_from_rotation(found[:3, :3] @ truth[:3, :3].T)))
    return float(turn), float(100 * np.linalg.norm(found[:3, 3] - truth[:3, 3]))
