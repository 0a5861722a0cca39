"""Frames that are not of one moment, while the craft turns: by cameras that are not triggered
together, and by rolling shutters, which read an image row by row.

Each row sees the horizon as it lies when that row is exposed. A ray is turned back by as much as
the craft has turned since the time of the set of frames, so that all of them are of that moment.
Source: derived here.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.cameras.derived_camera import DerivedCamera, intrinsics
from horizon_sensor_ros.core.mathematics.rigid import rotation_from_vector, skew
from horizon_sensor_ros.core.motion.turn_rate import TurnRate

# Steps towards the row in which a ray is seen: each leaves of its error what the limb moves by from
# one row to the next, some parts in a hundred at most. No more are made than is seen.
_STEPS, _NEAR_RAD = 6, 1e-9
# Rows beyond the frame, over its height, up to which the turn goes on growing.
_BEYOND = 1.0


@dataclass(frozen=True, eq=False)
class TurningCamera(DerivedCamera):
    """A camera that turns while it is read: its pixels, with the rays at the time of the set.

    turn_rad : (3,) by which the camera turns from one end of the frame to the other, downwards, in
    the optical frame. begins : share of that which is made when the first row is read.
    """

    turn_rad: np.ndarray = field(kw_only=True)
    begins: float = field(kw_only=True)

    def rays(self, px: np.ndarray) -> np.ndarray:
        """Unit rays (N, 3) at the time of the set; see `Camera.rays`."""
        rays = self.original.rays(px)
        return self._turned(rays, self._share(np.asarray(px, dtype=float)[:, 1]))

    def pixels(self, rays: np.ndarray) -> np.ndarray:
        """Raw pixels (N, 2) of rays at the time of the set; see `Camera.pixels`."""
        return self.original.pixels(self._when_read(np.asarray(rays, dtype=float))[0])

    def project(self, rays_unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels and their derivative by the rays; see `Camera.project`."""
        read, share = self._when_read(np.asarray(rays_unit, dtype=float))
        px, jacobian = self.original.project(read)
        later = self._by_share(jacobian, read)
        # Derivatives by the ray when it is read, turned to those by the ray at the set's time.
        shape = jacobian.shape
        at_set = self._turned(jacobian.reshape(-1, 3), np.repeat(share, 2)).reshape(shape)
        by_row = at_set[:, 1] / (1.0 - later[:, 1])[:, None]
        return px, at_set + later[:, :, None] * by_row[:, None]

    def project_along(
        self, rays_unit: np.ndarray, along: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Pixels, and how they move with the rays; see `Camera.project_along`."""
        px, jacobian = self.project(rays_unit)
        return px, np.einsum("nij,nj->ni", jacobian, along)

    def _share(self, row: np.ndarray) -> np.ndarray:
        """Share (N,) of the turn that is made when rows (N,) are read."""
        return self.begins + np.clip(row * self._per_row, -_BEYOND, 1.0 + _BEYOND)

    @property
    def _per_row(self) -> float:
        return 1.0 / max(self.height - 1, 1)

    def _turned(self, vectors: np.ndarray, share: np.ndarray) -> np.ndarray:
        """Vectors (N, 3), turned by shares (N,) of the camera's turn (Rodrigues)."""
        angle = self._angle_rad * share[:, None]
        once = vectors @ self._across
        return vectors + np.sin(angle) * once + (1.0 - np.cos(angle)) * (once @ self._across)

    @cached_property
    def _angle_rad(self) -> float:
        return float(np.linalg.norm(self.turn_rad))

    @cached_property
    def _across(self) -> np.ndarray:
        """What takes row vectors to the product of the turn's axis with them."""
        return skew(self.turn_rad / max(self._angle_rad, np.finfo(float).tiny)).T

    def _when_read(self, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rays (N, 3) as their row sees them, and the share (N,) of the turn at that time."""
        share = self._share(self.original.pixels(rays)[:, 1])
        for _ in range(_STEPS):
            read, before = self._turned(rays, -share), share
            share = self._share(self.original.pixels(read)[:, 1])
            # Of rays that no pixel sees it is not a number.
            if not (np.abs(share - before) * self._angle_rad > _NEAR_RAD).any():
                break
        return read, before

    def _by_share(self, jacobian: np.ndarray, read: np.ndarray) -> np.ndarray:
        """How far the pixels (N, 2) of rays move while a row is read. jacobian : (N, 2, 3)."""
        moving = read @ skew(self._per_row * self.turn_rad)
        return np.asarray(np.einsum("nij,nj->ni", jacobian, moving))


def view_at_stamp(view: CameraView, rate: TurnRate, after_s: float = 0.0) -> CameraView:
    """The camera as it sees the horizon at the time of a set of frames.

    rate : of the craft meanwhile. after_s : time of its image after that.
    """
    timed = replace(view, after_s=after_s, rate=rate)
    if view.readout_s == 0.0 and after_s == 0.0:
        return timed
    if view.readout_s == 0.0:
        turned = rotation_from_vector(after_s * rate.rate_base_rad_s)
        return replace(timed, rot_base_from_cam=turned @ view.rot_base_from_cam)
    camera = TurningCamera(
        **intrinsics(view.camera),
        turn_rad=view.readout_s * (rate.rate_base_rad_s @ view.rot_base_from_cam),
        begins=after_s / view.readout_s - (view.readout_s < 0.0),
    )
    return replace(timed, camera=camera)


def seen_late(view: CameraView) -> bool:
    """Whether a camera sees pixels at other times than that of the set, while the craft turns at a
    rate that is not quite known.
    """
    late = view.after_s != 0.0 or view.readout_s != 0.0
    return late and view.rate is not None and view.rate.sigma_rad_s > 0.0


def seen_after_s(view: CameraView, px: np.ndarray) -> np.ndarray:
    """Times (N,) at which a camera sees its pixels (N, 2), after that of the set."""
    share = px[:, 1] / max(view.camera.height - 1, 1) - (view.readout_s < 0.0)
    return np.asarray(view.after_s + view.readout_s * share)
