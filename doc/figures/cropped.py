"""A target behind an arm and before a wall: what of its cloud is used, and where it is taken to
end.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from figures.drawing import BLUE, ORANGE, save
from horizon_sensor_ros.core.mathematics.rigid import pose_matrix, rotation_from_vector
from horizon_sensor_ros.core.target_motion.ranges.crop import Crop
from horizon_sensor_ros.core.target_motion.target_view import TargetView, target_view
from horizon_sensor_ros.sim.shapes import sich_n5
from horizon_sensor_ros.sim.tof_camera import ToFCamera

_BOX = Crop((-2.0, -2.0, 4.0), (2.0, 2.0, 6.5))
_ARM_M, _ARM_PX, _WALL_M = 3.0, 7.0, 7.5
_ACROSS = np.array([0.5, 0.87])  # the arm, in the image


def draw(folder: Path) -> None:
    """Write cropped.png: N5, 5.3 m away."""
    points = _scene()
    kept, cropped = _BOX.split(points)
    figure, axes = plt.subplots(1, 3, figsize=(9.0, 2.7), layout="constrained")
    axes[0].imshow(points[..., 2], cmap="gray_r", vmin=2.0, vmax=9.0)
    axes[0].set_title("depth, as it came", fontsize=11)
    _draw_view(axes[1], target_view(kept), "cropped before the node")
    _draw_view(axes[2], target_view(kept, None, cropped), "cropped by the node")
    rows, columns = np.nonzero(np.isfinite(kept[..., 2]))
    axes[0].set_xlim(columns.min() - 8.5, columns.max() + 8.5)
    axes[0].set_ylim(rows.max() + 8.5, rows.min() - 8.5)
    for ax in axes:
        ax.set_xticks([])
        ax.set_yticks([])
    save(figure, folder / "cropped.png")


def _scene() -> np.ndarray:
    """(H, W, 3): the target, an arm before it, a wall behind it, 5 mm of noise."""
    camera, rng = ToFCamera(), np.random.default_rng(2)
    turned = rotation_from_vector(np.array([0.35, 0.6, 0.2]))
    points = camera.scan(sich_n5(), pose_matrix(turned, np.array([0.0, 0.0, 5.3])), rng).points
    rays = camera.rays()
    rays = rays / rays[..., 2:]
    row, column = np.indices(points.shape[:2])
    middle = np.array(points.shape[:2]) / 2.0
    arm = np.abs(np.stack([column - middle[1], row - middle[0]], axis=-1) @ _ACROSS) < _ARM_PX
    depth = np.where(arm, _ARM_M, _WALL_M) + rng.normal(0.0, 0.005, arm.shape)
    other = arm | ~np.isfinite(points[..., 2])
    points[other] = (rays * depth[..., None])[other]
    return points


def _draw_view(ax: Axes, view: TargetView, title: str) -> None:
    """Surface gray, what is unknown yellow, ends of faces as lines."""
    surface = view.surface
    assert surface is not None
    image = surface.image
    shade = np.ones((*image.inverse_depth.shape, 3))
    shade[image.inverse_depth > 0] = 0.8
    shade[image.unknown] = (1.0, 0.9, 0.75)
    ax.imshow(shade)
    edges = surface.edges
    ends = ~edges.creases
    points, along = edges.points[ends], edges.directions[ends]
    half_m = 1.5 * surface.footprint_m
    of_arm = _beside_arm(points, along, image.focal_px)
    for which, colour in ((~of_arm, BLUE), (of_arm, ORANGE)):
        ends_m = np.stack([(points - half_m * along)[which], (points + half_m * along)[which]])
        place = (ends_m[..., :2] / ends_m[..., 2:] - image.origin) * image.focal_px
        ax.plot(place[..., 0], place[..., 1], "-", color=colour, linewidth=1.5)
    ax.set_title(title, fontsize=11)


def _beside_arm(points: np.ndarray, along: np.ndarray, focal_px: float) -> np.ndarray:
    """Which ends, at points (N, 3) along directions (N, 3), lie beside the arm and along it."""
    across = points[:, :2] @ _ACROSS / points[:, 2] * focal_px
    beside = np.abs(np.abs(across) - _ARM_PX) < 2.0
    return np.asarray(beside & (np.abs(along[:, :2] @ _ACROSS) < 0.3))
