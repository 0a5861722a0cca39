"""The limb of a given cone in one image: where it runs and which way is out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.camera import CameraView

_COARSE = 384
_CONCENTRATION = 5.0  # how much denser the coarse azimuths lie near the optical axis


@dataclass(frozen=True)
class LimbCurve:
    """Points of the predicted limb inside the frame, evenly spaced along it.

    px : (N, 2) raw pixels. normal_px : (N, 2) unit, across the curve, towards space. rad_per_px :
    (N,) angle at the limb, away from nadir, of one pixel along the normal. azimuth_rad : (N,)
    angle about nadir, increasing.
    """

    px: np.ndarray
    normal_px: np.ndarray
    rad_per_px: np.ndarray
    azimuth_rad: np.ndarray

    def __len__(self) -> int:
        return len(self.px)


def limb_curve(
    view: CameraView,
    nadir_base: np.ndarray,
    rho_rad: float,
    *,
    spacing_px: float = 1.0,
    margin_px: float = 0.0,
) -> LimbCurve:
    """Draw the limb of the cone ``u . nadir = cos rho`` in the image of one camera.

    margin_px : points nearer to the frame's border than this are left out. No point in the frame:
    an empty curve.
    """
    nadir = view.rot_base_from_cam.T @ nadir_base
    cos_rho, sin_rho = np.cos(rho_rad), np.sin(rho_rad)
    # Azimuth zero is where the limb comes nearest to the optical axis.
    axis = np.array([0.0, 0.0, 1.0])
    first = axis - nadir[2] * nadir
    if np.linalg.norm(first) < 1e-9:
        first = np.array([1.0, 0.0, 0.0]) - nadir[0] * nadir
    first /= np.linalg.norm(first)
    second = np.cross(nadir, first)

    def rays_at(azimuth: np.ndarray) -> np.ndarray:
        return (
            cos_rho * nadir
            + (sin_rho * np.cos(azimuth))[:, None] * first
            + (sin_rho * np.sin(azimuth))[:, None] * second
        )

    t = np.linspace(-1.0, 1.0, _COARSE)
    coarse = np.pi * np.sinh(_CONCENTRATION * t) / np.sinh(_CONCENTRATION)
    px = view.camera.pixels(rays_at(coarse))
    inside = _within(view, px, margin_px)
    # A cell counts when either end is inside; its length comes from the chord of its two ends.
    cell = inside[:-1] | inside[1:]
    length = np.where(cell, np.linalg.norm(np.diff(px, axis=0), axis=1), 0.0)
    length[~np.isfinite(length)] = 0.0
    total = np.concatenate([[0.0], np.cumsum(length)])
    if total[-1] < spacing_px:
        empty = np.empty((0, 2))
        return LimbCurve(empty, empty, np.empty(0), np.empty(0))
    at = np.arange(0.5 * spacing_px, total[-1], spacing_px)
    # Cells outside have no length: the strictly increasing part of `total` is what can be inverted.
    rising = np.concatenate([[True], np.diff(total) > 0])
    starts = np.flatnonzero(rising[1:])
    index = starts[np.searchsorted(total[starts + 1], at, side="right").clip(0, len(starts) - 1)]
    share = (at - total[index]) / (total[index + 1] - total[index])
    azimuth = coarse[index] + share * (coarse[index + 1] - coarse[index])
    rays = rays_at(azimuth)
    px, jacobian = view.camera.project(rays)
    keep = _within(view, px, margin_px)
    px, jacobian, rays, azimuth = px[keep], jacobian[keep], rays[keep], azimuth[keep]
    along = np.outer(np.cos(azimuth), second) - np.outer(np.sin(azimuth), first)
    tangent = np.einsum("nij,nj->ni", jacobian, along)
    # Outwards on the sphere of directions: away from nadir.
    outward = (cos_rho * rays - nadir) / sin_rho
    away = np.einsum("nij,nj->ni", jacobian, outward)
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    across = np.sum(normal * away, axis=1)
    normal *= np.sign(across)[:, None]
    return LimbCurve(px, normal, 1.0 / np.abs(across), azimuth)


def _within(view: CameraView, px: np.ndarray, margin_px: float) -> np.ndarray:
    camera = view.camera
    with np.errstate(invalid="ignore"):
        return (
            (px[:, 0] >= margin_px)
            & (px[:, 0] <= camera.width - 1 - margin_px)
            & (px[:, 1] >= margin_px)
            & (px[:, 1] <= camera.height - 1 - margin_px)
        )
