"""The target in the demo's report: clouds before and after registration, and the errors' path."""

from __future__ import annotations

import matplotlib as mpl

mpl.use("Agg")  # no display needed, none opened

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from horizon_sensor_ros.core.target.rigid import inverse_pose
from horizon_sensor_ros.tools.demo_target_errors import MotionErrors, TargetErrors

_MARGIN_M = 0.05
# Told apart by the colour-blind as well.
_OLD, _NEW, _BAND = "#0b6e99", "#d9480f", "#0b6e9930"


def cloud_figure(
    old: np.ndarray, new: np.ndarray, pose_old: np.ndarray, pose_new: np.ndarray
) -> Figure:
    """Two clouds (N, 3) as they came, and the old one moved by what was found, from two sides.

    pose_old, pose_new : (4, 4) published with them, of one target frame in the sensor frame.
    """
    motion = pose_new @ inverse_pose(pose_old)
    moved = old @ motion[:3, :3].T + motion[:3, 3]
    everything = np.concatenate([old, new, moved])
    low, high = (f(everything, axis=0) for f in (np.nanmin, np.nanmax))
    low, high = low - _MARGIN_M, high + _MARGIN_M
    figure, axes = plt.subplots(2, 2, figsize=(9.0, 7.6), layout="constrained")
    for column, (cloud, title) in enumerate(
        ((old, "as they came"), (moved, "earlier one moved as found"))
    ):
        for row, (up, name) in enumerate(((1, "y (down), m"), (2, "z (away), m"))):
            ax: Axes = axes[row, column]
            ax.plot(cloud[:, 0], cloud[:, up], ".", color=_OLD, markersize=1.6, label="earlier")
            # Every other point, so as not to hide what lies under it.
            ax.plot(new[::2, 0], new[::2, up], ".", color=_NEW, markersize=1.6, label="later")
            ax.set(xlabel="x (right), m", ylabel=name, aspect="equal")
            ax.set(xlim=(low[0], high[0]), ylim=(low[up], high[up]))
            if row == 0:
                ax.invert_yaxis()
                ax.set_title(title, fontsize=11)
    axes[1, 0].legend(loc="upper center", markerscale=5)
    return figure


def error_figure(errors: TargetErrors) -> Figure:
    """Sizes of the errors of pose and delta over the time, with three sigma."""
    figure, axes = plt.subplots(2, 2, figsize=(10.0, 5.4), sharex=True, layout="constrained")
    for column, (name, motion) in enumerate(
        (("target/pose", errors.pose), ("target/pose_delta", errors.delta))
    ):
        _path(axes[0, column], errors.time_s, motion, turn=True)
        _path(axes[1, column], errors.time_s, motion, turn=False)
        axes[0, column].set_title(name, fontsize=11)
        axes[1, column].set_xlabel("time, s")
    axes[0, 0].set_ylabel("turn, deg")
    axes[1, 0].set_ylabel("shift, cm")
    return figure


def _path(ax: Axes, time_s: np.ndarray, motion: MotionErrors, *, turn: bool) -> None:
    if turn:
        values, sigmas = np.degrees(motion.rotation), np.degrees(motion.rotation_sigma)
    else:
        values, sigmas = 100 * motion.shift, 100 * motion.shift_sigma
    ax.fill_between(time_s, 0.0, 3 * sigmas, color=_BAND, linewidth=0)
    ax.plot(time_s, values, color=_OLD, linewidth=1.2, marker=".", markersize=3)
    missing = time_s[~np.isfinite(values)]
    foot = np.full(len(missing), 0.02)
    ax.plot(missing, foot, "|", color=_NEW, transform=ax.get_xaxis_transform())
    ax.set_ylim(bottom=0.0)
    ax.grid(alpha=0.3)
