"""A target before a wall: under the motion found, none, the target's patches are off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from figures.drawing import save
from horizon_sensor_ros.core.mathematics.rigid import (
    inverse_pose,
    pose_matrix,
    rotation_from_vector,
)
from horizon_sensor_ros.core.target_motion.judgement.one_body import most_off_m, patches_of
from horizon_sensor_ros.core.target_motion.target_view import target_view
from horizon_sensor_ros.sim.shapes import TARGETS, assembly, box
from horizon_sensor_ros.sim.tof_camera import ToFCamera

_BEFORE = pose_matrix(rotation_from_vector(np.array([0.5, 0.7, 0.3])), [0.05, 0.0, 5.3])
_TURN = rotation_from_vector(np.radians([1.5, 2.0, 1.0]))
_AFTER = pose_matrix(_TURN @ _BEFORE[:3, :3], _BEFORE[:3, 3])


def draw(folder: Path) -> None:
    """Write one_body.png."""
    mesh, camera, rng = TARGETS["n5"](), ToFCamera(), np.random.default_rng(1)
    wall = box((6, 6, 0.02), (0, 0, 6.4))
    figure, axes = plt.subplots(1, 2, figsize=(6.5, 3.3), layout="constrained")
    motion = _AFTER @ inverse_pose(_BEFORE)
    for ax, title, beside, moved in (
        (axes[0], "N5 alone, its motion", [], motion),
        (axes[1], "before a wall, the wall's motion", [wall], np.eye(4)),
    ):
        scans = (
            camera.scan(assembly([mesh.moved(pose[:3, :3], pose[:3, 3]), *beside]), np.eye(4), rng)
            for pose in (_BEFORE, _AFTER)
        )
        a, b = (target_view(scan.points).surface for scan in scans)
        assert a is not None
        assert b is not None
        off = patches_of(a, b, moved[:3, :3], moved[:3, 3]).off_m
        limit = 1e3 * most_off_m(a, b)
        shown = ax.imshow(1e3 * off, cmap="RdBu_r", vmin=-20, vmax=20)
        worst = 1e3 * np.nanmax(np.abs(off))
        ax.set_title(f"{title}\nmost {worst:.1f} mm, allowed {limit:.1f} mm", fontsize=10)
        ax.set_facecolor("0.85")
        ax.set(xticks=[], yticks=[])
    figure.colorbar(shown, ax=axes, label="patches off, mm", shrink=0.8)
    save(figure, folder / "one_body.png")
