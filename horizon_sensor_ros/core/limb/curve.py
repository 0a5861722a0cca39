"""The limb of a given cone in one image: where it runs and which way is out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.camera import Camera, CameraView

_COARSE = 384
_CONCENTRATION = 5.0  # how much denser the coarse azimuths lie near the optical axis


def _circle(azimuth_rad: np.ndarray) -> np.ndarray:
    """Rows (N, 3) of one, cosine and sine: once round a cone, in axes of its own."""
    out = np.empty((len(azimuth_rad), 3))
    out[:, 0] = 1.0
    np.cos(azimuth_rad, out=out[:, 1])
    np.sin(azimuth_rad, out=out[:, 2])
    return out


_COARSE_RAD = (
    np.pi * np.sinh(_CONCENTRATION * np.linspace(-1.0, 1.0, _COARSE)) / np.sinh(_CONCENTRATION)
)
_COARSE_CIRCLE = _circle(_COARSE_RAD)


@dataclass(frozen=True)
class LimbCurve:
    """Points of the predicted limb inside the frame, evenly spaced along it.

    px : (N, 2) raw pixels. normal_px : (N, 2) unit, across the curve, towards space. spacing_px :
    of the points.
    """

    px: np.ndarray
    normal_px: np.ndarray
    spacing_px: float = 1.0

    def __len__(self) -> int:
        return len(self.px)

    def thinned(self, spacing_px: float) -> LimbCurve:
        """Every so many-th point, about `spacing_px` apart."""
        step = max(1, round(spacing_px / self.spacing_px))
        return LimbCurve(self.px[::step], self.normal_px[::step], step * self.spacing_px)


def limb_curve(
    view: CameraView, nadir_base: np.ndarray, rho_rad: float, *, spacing_px: float = 1.0
) -> LimbCurve:
    """Draw the limb of the cone ``u . nadir = cos rho`` in the image of one camera.

    Arc by arc in the order of the azimuth about nadir. No point in the frame: an empty curve.
    """
    camera = view.camera
    cone = _cone(view.rot_base_from_cam.T @ nadir_base, rho_rad)
    px = camera.pixels(_COARSE_CIRCLE @ cone)
    inside = _within(camera, px)
    # A cell counts when either end is inside; its length comes from the chord of its two ends.
    chord = px[1:] - px[:-1]
    length = np.hypot(chord[:, 0], chord[:, 1])
    length[~((inside[:-1] | inside[1:]) & (length < np.inf))] = 0.0
    total = np.zeros(_COARSE)
    np.cumsum(length, out=total[1:])
    if total[-1] < spacing_px:
        return LimbCurve(np.empty((0, 2)), np.empty((0, 2)), spacing_px)
    azimuth = np.interp(np.arange(0.5 * spacing_px, total[-1], spacing_px), total, _COARSE_RAD)
    circle = _circle(azimuth)
    px, jacobian = camera.project(circle @ cone)
    # Along the limb, by azimuth: minus the sine, and the cosine.
    along = circle[:, 2:0:-1] @ (cone[1:] * _TURNED)
    tangent = np.einsum("nij,nj->ni", jacobian, along)
    keep = _within(camera, px)
    if not keep.all():
        px, tangent = px[keep], tangent[keep]
    # A camera does not mirror: out of the limb is to the same side of it in every image.
    normal = tangent[:, ::-1] * _TURNED.T[:, ::-1]
    normal /= np.hypot(tangent[:, 0], tangent[:, 1])[:, None]
    return LimbCurve(px, normal, spacing_px)


_TURNED = np.array([[-1.0], [1.0]])


def _cone(nadir: np.ndarray, rho_rad: float) -> np.ndarray:
    """Rows (3, 3): a cone's axis and the two vectors that turn about it, so long that together they
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
            [along * x, along * y, along * z],
            [a, b, c],
            [y * c - z * b, z * a - x * c, x * b - y * a],
        ]
    )


def _within(camera: Camera, px: np.ndarray) -> np.ndarray:
    """Whether pixels (N, 2) lie between the centres of the frame's outermost; not where NaN."""
    x, y = px.T
    with np.errstate(invalid="ignore"):
        return (x >= 0) & (x <= camera.width - 1) & (y >= 0) & (y <= camera.height - 1)
