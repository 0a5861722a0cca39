"""A cloud that was swept while the target turned, as it came and as it is used; and what times of
points are worth.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from figures.drawing import BLUE, ORANGE, save
from horizon_sensor_ros.core.mathematics.rigid import inverse_pose, vector_from_rotation
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.config import RegistrationConfig, TrackerConfig
from horizon_sensor_ros.core.target_motion.sweeps.sweep import sweep_of
from horizon_sensor_ros.core.target_motion.sweeps.velocity import Velocity
from horizon_sensor_ros.core.target_motion.tracker import TargetTracker
from horizon_sensor_ros.sim.swept_scan import SweptScan, swept_scan
from horizon_sensor_ros.sim.tof_camera import ToFCamera
from horizon_sensor_ros.sim.tumbling import TumblingTarget

_PERIOD_S, _CLOUDS, _SHOWN = 0.2, 12, 2
_WIDE = RegistrationConfig(max_rotation_sigma_rad=np.radians(2.0), max_shift_sigma_m=0.05)


def draw(folder: Path) -> None:
    """Write swept.png: N5, 30 deg/s, swept in all of the 0.2 s between two clouds."""
    target = TumblingTarget(
        camera=ToFCamera(width=128, height=128, pixel_pitch_m=65e-6),
        precession_rad_s=np.radians(30.0),
        spin_rad_s=0.0,
    )
    clouds = [
        swept_scan(
            target.camera,
            target.mesh,
            target.pose,
            k * _PERIOD_S,
            _PERIOD_S,
            np.random.default_rng(k),
        )
        for k in range(_CLOUDS)
    ]
    figure, axes = plt.subplots(1, 3, figsize=(9.0, 3.0), layout="constrained")
    _draw_cloud(axes[:2], clouds[_SHOWN], target)
    for told, colour in ((False, ORANGE), (True, BLUE)):
        number, error, sigma = _tracked(clouds, target, told)
        label = "times told" if told else "not told"
        axes[2].plot(number, error, "o-", color=colour, markersize=3, label=label)
        axes[2].plot(number, sigma, ":", color=colour)
    axes[2].set_title("turn off, and one sigma, deg", fontsize=11)
    axes[2].set_xlabel("cloud")
    axes[2].set_ylim(bottom=0.0)
    axes[2].grid(alpha=0.3)
    axes[2].legend(loc="upper left")
    save(figure, folder / "swept.png")


def _draw_cloud(axes: np.ndarray, cloud: SweptScan, target: TumblingTarget) -> None:
    """As it came, and stilled by the true velocity, before the target as it was at the stamp."""
    stamp_s = _SHOWN * _PERIOD_S
    at_once = target.camera.scan(target.mesh, target.pose(stamp_s)).plain()
    velocity = Velocity.between(
        target.pose(stamp_s), target.pose(stamp_s + _PERIOD_S), _PERIOD_S, np.zeros((6, 6))
    )
    sweep = sweep_of(cloud.points, cloud.times_s)
    assert sweep is not None
    image = sweep.stilled(velocity)
    rows, columns = np.nonzero(image.inverse_depth)
    across, down = image.tangents()
    stilled = np.stack([across[columns], down[rows]])
    for ax, title, colour, came in (
        (axes[0], "as it came", ORANGE, sweep.points[:, :2].T / sweep.points[:, 2]),
        (axes[1], "brought to the stamp", BLUE, stilled),
    ):
        _dots(ax, at_once[:, :2].T / at_once[:, 2], "0.8", 12.0)
        _dots(ax, came, colour, 2.0)
        ax.set_title(title, fontsize=11)
        ax.set_aspect("equal")
        ax.invert_yaxis()
        ax.set_xticks([])
        ax.set_yticks([])


def _dots(ax: Axes, place: np.ndarray, colour: str, size: float) -> None:
    ax.scatter(*place, s=size, color=colour, linewidths=0.0)


def _tracked(
    clouds: list[SweptScan], target: TumblingTarget, told: bool
) -> tuple[list[int], list[float], list[float]]:
    """Number of each cloud after the first that was let through, by how much the turn since then is
    off, and its sigma about the least certain axis, deg.
    """
    tracker = TargetTracker(TrackerConfig(_WIDE))
    number, error, sigma = [], [], []
    frame = None
    for k, cloud in enumerate(clouds):
        times_s = cloud.times_s if told else None
        fix = tracker.process(cloud.points, round(k * _PERIOD_S * 1e9), times_s=times_s)
        if fix.status is not Status.OK:
            continue
        pose, true = fix.pose_sensor_from_target, target.pose(k * _PERIOD_S)
        if frame is None:
            frame = inverse_pose(true) @ pose
            continue
        turn = vector_from_rotation((true @ frame)[:3, :3] @ pose[:3, :3].T)
        number.append(k)
        error.append(float(np.degrees(np.linalg.norm(turn))))
        sigma.append(float(np.degrees(np.sqrt(np.linalg.eigvalsh(fix.covariance[:3, :3])[-1]))))
    return number, error, sigma
