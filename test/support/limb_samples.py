"""Limb points made from the horizon's cone itself, through numerics of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.status import Status

PINHOLE = Camera(640, 480, 500.0, 495.0, 320.3, 238.9)
BARREL = Camera(640, 480, 420.0, 415.0, 318.3, 241.7, "plumb_bob", (-0.3, 0.1, 1e-3, -2e-3, 0.02))
RATIONAL = Camera(
    800, 600, 560.0, 562.0, 402.0, 297.0, "rational_polynomial",
    (1.2, 0.5, 1e-3, -5e-4, 0.02, 1.5, 0.8, 0.1),
)  # fmt: skip
FISHEYE = Camera(
    640, 640, 180.0, 181.0, 321.0, 318.0, "equidistant", (0.02, -0.004, 0.001, -0.0003)
)
CAMERAS = (PINHOLE, BARREL, RATIONAL, FISHEYE)


def cone_rays(nadir: np.ndarray, rho_rad: float, azimuth_rad: np.ndarray) -> np.ndarray:
    """Rays at angle rho from nadir: nadir's neighbour at rho, turned about nadir."""
    helper = np.eye(3)[np.argmin(np.abs(nadir))]
    axis = np.cross(nadir, helper)
    start = Rotation.from_rotvec(axis / np.linalg.norm(axis) * rho_rad).apply(nadir)
    return Rotation.from_rotvec(np.outer(azimuth_rad, nadir)).apply(start)


def view_at_limb(
    camera: Camera,
    nadir_base: np.ndarray,
    rho_rad: float,
    azimuth_rad: float,
    roll_rad: float = 0.0,
    offset_rad: float = 0.0,
    name: str = "camera_1",
) -> CameraView:
    """A camera whose axis points at the limb (offset towards space), turned about its axis."""
    axis = cone_rays(nadir_base, rho_rad + offset_rad, np.array([azimuth_rad]))[0]
    side = np.cross(nadir_base, axis)
    side /= np.linalg.norm(side)
    rot = np.column_stack((side, np.cross(axis, side), axis))
    return CameraView(name, camera, rot @ Rotation.from_euler("z", roll_rad).as_matrix())


def observe(
    view: CameraView,
    nadir_base: np.ndarray,
    rho_rad: float,
    sigma_px: float = 0.1,
    noise: np.random.Generator | None = None,
    spacing_px: float = 2.0,
    arc_rad: float | None = None,
) -> LimbObservation:
    """Limb points in the frame, some spacing_px apart, moved along their normals by noise.

    Normals are from neighbouring points of the projected limb, space from the next wider cone.
    arc_rad keeps that much of the limb, in azimuth about nadir, around the middle of what is seen.
    """
    azimuth = np.linspace(-np.pi, np.pi, 20001)[:-1]
    limb = cone_rays(nadir_base, rho_rad, azimuth) @ view.rot_base_from_cam
    px = view.camera.pixels(limb)
    seen = view.camera.in_frame(px)
    if arc_rad is not None and seen.any():
        middle = np.angle(np.exp(1j * azimuth[seen]).sum())
        seen &= np.abs(np.angle(np.exp(1j * (azimuth - middle)))) <= arc_rad / 2
    index = np.flatnonzero(seen)
    if index.size:
        step_px = np.linalg.norm(np.diff(px, axis=0, append=px[:1]), axis=1)
        # The next one may be beyond where the lens folds.
        length = np.cumsum(np.nan_to_num(step_px[index]))
        cells = np.floor(length / spacing_px)
        index = index[np.flatnonzero(np.diff(cells, prepend=-1.0) > 0)]
    azimuth = azimuth[index]
    step = 1e-5
    px = view.camera.pixels(cone_rays(nadir_base, rho_rad, azimuth) @ view.rot_base_from_cam)
    ahead = view.camera.pixels(
        cone_rays(nadir_base, rho_rad, azimuth + step) @ view.rot_base_from_cam
    )
    wider = view.camera.pixels(
        cone_rays(nadir_base, rho_rad + step, azimuth) @ view.rot_base_from_cam
    )
    tangent = ahead - px
    normal = np.column_stack((-tangent[:, 1], tangent[:, 0]))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= np.sign(np.einsum("ij,ij->i", normal, wider - px))[:, None]
    keep = np.isfinite(px).all(axis=1) & np.isfinite(normal).all(axis=1)
    px, normal = px[keep], normal[keep]
    if noise is not None:
        px = px + normal * noise.normal(0.0, sigma_px, len(px))[:, None]
    return LimbObservation(view, LimbPoints(Status.OK, "", px, normal, np.full(len(px), sigma_px)))


def turned(
    observations: list[LimbObservation], sigma_rad: float, rng: np.random.Generator
) -> list[LimbObservation]:
    """The same limbs, seen by cameras that are each turned by a random angle about every axis."""
    out = []
    for seen in observations:
        turn = Rotation.from_rotvec(rng.normal(0.0, sigma_rad, 3)).as_matrix()
        view = replace(seen.view, rot_base_from_cam=turn @ seen.view.rot_base_from_cam)
        out.append(LimbObservation(view, seen.limb))
    return out


def nadir_nees(fit: HorizonFit, nadir_base: np.ndarray) -> float:
    """Squared error of nadir in its own sigmas: of two unknowns."""
    basis = tangent_basis(fit.nadir_base)
    error = basis.T @ nadir_base
    cov = basis.T @ fit.cov_nadir_altitude[:3, :3] @ basis
    return float(error @ np.linalg.solve(cov, error))
