"""The limb of a given cone in one image: where it runs and which way is out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView

_COARSE = 384
# Steps in which nadir and the logarithm of rho are told apart to see which azimuths are in the
# frame, what such a step may move them by, and how near nadir may be to the optical axis for that.
_STEP_RAD, _MARGIN_RAD, _MOST_COSINE = 0.005, 0.025, 0.87
_IN_SIGHT_PX = 16.0  # spacing of points that tell whether the limb is in a frame
_CONCENTRATION = 5.0  # how much denser the coarse azimuths lie near the optical axis


def _circle(azimuth_rad: np.ndarray) -> np.ndarray:
    """One, cosine and sine (3, N): once round a cone, in axes of its own."""
    out = np.empty((3, len(azimuth_rad)))
    out[0] = 1.0
    np.cos(azimuth_rad, out=out[1])
    np.sin(azimuth_rad, out=out[2])
    return out


_COARSE_RAD = (
    np.pi * np.sinh(_CONCENTRATION * np.linspace(-1.0, 1.0, _COARSE)) / np.sinh(_CONCENTRATION)
)
_COARSE_CIRCLE = _circle(_COARSE_RAD)


@dataclass(frozen=True, eq=False)
class LimbCurve:
    """Points of the predicted limb inside the frame, evenly spaced along it.

    px : (N, 2) raw pixels. normal_px : (N, 2) unit, across the curve, towards space. spacing_px :
    of the points.
    """

    px: np.ndarray
    normal_px: np.ndarray
    spacing_px: float

    def __len__(self) -> int:
        return len(self.px)

    @cached_property
    def single(self) -> tuple[np.ndarray, np.ndarray]:
        """px and normal_px, each (2, N) in single precision."""
        return self.px.T.astype(np.float32), self.normal_px.T.astype(np.float32)

    def thinned(self, spacing_px: float) -> LimbCurve:
        """Every so many-th point, about `spacing_px` apart."""
        step = max(1, round(spacing_px / self.spacing_px))
        return LimbCurve(self.px[::step], self.normal_px[::step], step * self.spacing_px)


def limb_in_sight(view: CameraView, nadir_base: np.ndarray, rho_rad: float) -> LimbCurve:
    """`limb_curve` with no more points than tell whether, and how much of it, is in the frame."""
    return limb_curve(view, nadir_base, rho_rad, spacing_px=_IN_SIGHT_PX)


def limb_curve(
    view: CameraView, nadir_base: np.ndarray, rho_rad: float, *, spacing_px: float = 1.0
) -> LimbCurve:
    """Draw the limb of the cone ``u . nadir = cos rho`` in the image of one camera.

    nadir_base : (3,), base frame. Points lie about spacing_px apart, arc by arc in the order of the
    azimuth about nadir. No point in the frame: an empty curve.
    """
    camera = view.camera
    nadir = view.rot_base_from_cam.T @ nadir_base
    circle = _visible(camera, nadir, rho_rad, spacing_px)
    if circle.shape[1] == 0:
        return LimbCurve(np.empty((0, 2)), np.empty((0, 2)), spacing_px)
    cone = _cone(nadir, rho_rad)
    both = np.zeros((6, 3))
    both[:3] = cone
    # Along the limb, by azimuth: minus the sine, and the cosine.
    both[3:, 1], both[3:, 2] = cone[:, 2], -cone[:, 1]
    rays = both @ circle
    px, tangent = camera.project_along(rays[:3].T, rays[3:].T)
    keep = np.flatnonzero(_within(camera, px))
    if len(keep) < len(px):
        # One arc, as a rule.
        whole = len(keep) > 0 and keep[-1] - keep[0] + 1 == len(keep)
        part = slice(keep[0], keep[-1] + 1) if whole else keep
        px, tangent = px[part], tangent[part]
    # A camera does not mirror: out of the limb is to the same side of it in every image.
    x, y = tangent.T
    normal = np.empty((2, len(px)))
    length = np.hypot(x, y)
    np.divide(y, length, out=normal[0])
    np.divide(x, -length, out=normal[1])
    return LimbCurve(px, normal.T, spacing_px)


def _visible(camera: Camera, nadir: np.ndarray, rho_rad: float, spacing_px: float) -> np.ndarray:
    """`_circle` (3, N) of the azimuths of points so far apart, of all of the limb that is in the
    frame and a little more.
    """
    # From frame to frame they hardly change, but where the limb goes round the optical axis.
    if not (abs(float(nadir[2])) <= _MOST_COSINE and rho_rad > 0.0):
        return _evenly(camera, _cone(nadir, rho_rad), spacing_px, 0.0)
    steps = tuple(round(component / _STEP_RAD) for component in nadir.tolist())
    return _nearly_visible(camera, steps, round(math.log(rho_rad) / _STEP_RAD), spacing_px)


@lru_cache(maxsize=32)
def _nearly_visible(
    camera: Camera, nadir_steps: tuple[int, ...], log_rho_steps: int, spacing_px: float
) -> np.ndarray:
    nadir = np.array(nadir_steps, dtype=float)
    cone = _cone(nadir / math.sqrt(nadir @ nadir), math.exp(log_rho_steps * _STEP_RAD))
    return _evenly(camera, cone, spacing_px, _MARGIN_RAD * max(camera.fx, camera.fy))


def _evenly(camera: Camera, cone: np.ndarray, spacing_px: float, margin_px: float) -> np.ndarray:
    """`_circle` (3, N) of points of a cone so far apart, in the frame or not far from it."""
    px = camera.pixels((cone @ _COARSE_CIRCLE).T)
    inside = _within(camera, px, margin_px)
    # A cell counts when either end is inside; its length comes from the chord of its two ends.
    chord = px.T[:, 1:] - px.T[:, :-1]
    length = np.hypot(*chord)
    length[~((inside[:-1] | inside[1:]) & (length < np.inf))] = 0.0
    total = np.zeros(_COARSE)
    np.cumsum(length, out=total[1:])
    along = np.arange(0.5 * spacing_px, total[-1], spacing_px)
    return _circle(np.interp(along, total, _COARSE_RAD))


def _cone(nadir: np.ndarray, rho_rad: float) -> np.ndarray:
    """Columns (3, 3): a cone's axis and two vectors that turn about it, so long that together they
    are its rays.

    Azimuth zero is where the limb comes nearest to the optical axis.
    """
    x, y, z = nadir.tolist()
    a, b, c = -z * x, -z * y, 1.0 - z * z
    if math.hypot(a, b, c) < 1e-9:
        a, b, c = 1.0 - x * x, -x * y, -x * z
    along, across = math.cos(rho_rad), math.sin(rho_rad)
    size = across / math.hypot(a, b, c)
    a, b, c = size * a, size * b, size * c
    return np.array(
        [
            [along * x, a, y * c - z * b],
            [along * y, b, z * a - x * c],
            [along * z, c, x * b - y * a],
        ]
    )


def _within(camera: Camera, px: np.ndarray, margin_px: float = 0.0) -> np.ndarray:
    """Whether pixels (N, 2) lie between the centres of the frame's outermost, or so far outside;
    not where NaN.
    """
    half = np.array([[camera.width - 1.0], [camera.height - 1.0]]) * 0.5
    with np.errstate(invalid="ignore"):
        inside = np.abs(px.T - half) <= half + margin_px
    return np.asarray(inside[0] & inside[1])
