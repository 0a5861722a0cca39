"""Where to point the cameras: the sigma to be expected over angle of mounting and altitude."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from tqdm import tqdm

from horizon_sensor_ros.core.applicability.visibility import rot_base_from_down
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.bound import nadir_sigma_bound_rad
from horizon_sensor_ros.core.mathematics.rigid import rotation_from_vector
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.tools.applicability.expected_sigma import information_of

ALTITUDES = 9
STEP_DEG = 2.0
_LEAST_TILT = 1e-3  # sine of the angle to nadir below which an axis has no direction to tilt in
_NEAR_BEST = 1.5  # angles whose worst sigma is up to this many times the best are as good as it


@dataclass(frozen=True, eq=False)
class Mountings:
    """What each angle of mounting gives.

    depression_deg (D,) : of the optical axes below the local horizontal of the craft at zero
    angles. altitudes_m (A,). sigma_rad (D, A) : worst over the craft's tilts, of nadir in its least
    certain direction, infinite where a tilt shows no limb, or too little of it.
    """

    depression_deg: np.ndarray
    altitudes_m: np.ndarray
    sigma_rad: np.ndarray

    @property
    def good(self) -> slice:
        """Stretch of angles that work at most altitudes, and there nearly as well as the best."""
        works = np.isfinite(self.sigma_rad).sum(axis=1)
        worst = np.where(np.isfinite(self.sigma_rad), self.sigma_rad, 0.0).max(axis=1)
        best = int(np.lexsort((worst, -works))[0])
        good = (works == works[best]) & (worst <= _NEAR_BEST * worst[best])
        low = high = best
        while low > 0 and good[low - 1]:
            low -= 1
        while high < len(good) - 1 and good[high + 1]:
            high += 1
        return slice(low, high + 1)

    @property
    def best(self) -> int:
        """Index of the angle in the middle of `good`: that with most room on both sides."""
        return (self.good.start + self.good.stop - 1) // 2


def depression_deg(view: CameraView, nadir_base: np.ndarray) -> float:
    """Angle (deg) of a camera's optical axis below the horizontal."""
    return float(np.degrees(np.arcsin(np.clip(view.rot_base_from_cam[:, 2] @ nadir_base, -1, 1))))


def tilted(view: CameraView, nadir_base: np.ndarray, angle_deg: float) -> CameraView:
    """Return the camera turned about a horizontal axis to look this far below the horizontal.

    Its azimuth stays, and its frame's turn about the optical axis. Raises ValueError for a camera
    that looks straight up or down: it has no azimuth.
    """
    axis = view.rot_base_from_cam[:, 2]
    across = np.cross(axis, nadir_base)
    if np.linalg.norm(across) < _LEAST_TILT:
        raise ValueError(
            f"{view.name} looks straight up or down, so that there is no direction to tilt it in; "
            "give it a rotation in which it looks to a side"
        )
    by = np.radians(angle_deg - depression_deg(view, nadir_base))
    turn = rotation_from_vector(by * across / np.linalg.norm(across))
    return replace(view, rot_base_from_cam=turn @ view.rot_base_from_cam)


def mountings(
    views: Sequence[CameraView],
    planet: Planet,
    nadir_at_zero: np.ndarray,
    altitudes_m: tuple[float, float],
    sigma_px: float,
    tilt_deg: float = 0.0,
    step_deg: float = STEP_DEG,
) -> Mountings:
    """Sigma of the fix from all these cameras, each tilted alike, over angle and altitude.

    tilt_deg : the craft turns by up to this about its two level axes; the extremes are taken, and
    the worst counts. Raises ValueError as `tilted` and `information_of` do.
    """
    low, high = altitudes_m
    heights = np.geomspace(low, high, ALTITUDES) if high > low else np.array([low])
    angles = np.arange(0.0, 90.0, step_deg)
    turns = [(0.0, 0.0)]
    if tilt_deg > 0:
        turns += [(tilt_deg, 0.0), (-tilt_deg, 0.0), (0.0, tilt_deg), (0.0, -tilt_deg)]
    nadirs = [_tilted_nadir(nadir_at_zero, *np.radians(turn)) for turn in turns]
    sigma = np.empty((angles.size, heights.size))
    for i, angle in enumerate(tqdm(angles, desc="mounting", unit="angle", leave=False)):
        turned = [tilted(view, nadir_at_zero, float(angle)) for view in views]
        for j, height in enumerate(heights):
            sigma[i, j] = max(
                nadir_sigma_bound_rad(
                    np.sum(
                        [information_of(v, planet, nadir, height, sigma_px) for v in turned],
                        axis=0,
                    )
                )
                for nadir in nadirs
            )
    return Mountings(angles, heights, sigma)


def _tilted_nadir(nadir_at_zero: np.ndarray, one_rad: float, other_rad: float) -> np.ndarray:
    """Nadir in the base frame of a craft that leans by two angles about its two level axes."""
    level = rot_base_from_down(0.0, 0.0, 0.0, nadir_at_zero)[0]
    leaning = np.array([np.sin(one_rad), np.sin(other_rad), np.cos(one_rad) * np.cos(other_rad)])
    return np.asarray(level @ (leaning / np.linalg.norm(leaning)))
