"""The limb under glowing air, by the contour of the glow above it.

Where ground is dark the planet's edge hardly shows through the glow, and where cloud begins just
behind it the edge seems to lie there: whole stretches of edges are off together, and on a short arc
that bends the limb. A contour of the glow above, over black space, has no such texture. Its
distance from the limb is not known, but the air is the same all along: as an angle that distance
changes slowly, with the Sun's height. So the edges tell the distance, and the contour its shape.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from horizon_sensor_ros.core.limb.profiles import EdgePlaces
from horizon_sensor_ros.core.limb_points import BEND_OF_STRETCHES, SLOPE_OF_STRETCHES
from horizon_sensor_ros.core.mathematics.robust import median, robust_sigma

_FROM_PX = 1.5  # beyond the edge, where the glow is looked at
_OWN_LEVEL = 0.5  # share of a profile's mean that is its own background's, not its glow's
_LEAST_SAMPLES, _LEAST_PROFILES = 4, 8
_FAINTEST, _BRIGHTEST = 0.2, 5.0  # glow over the usual one that may still be the same air's
_MAX_MISFIT = 4.0  # of a profile's glow to the usual one's shape: more is a star, or the craft
_TURN = -0.5  # cosine of the angle that the limb may turn through: "slowly" means nothing farther
# Distance from edge to contour along the limb, a quadratic: how far it may bend, as a share of the
# length over which glow fades, and as a share of its slope where twilight makes it slope.
_BEND, _BEND_OF_SLOPE = 0.2, 0.4
_NEIGHBOURS = 3.0  # edges next to each other that are off together
_EDGE_SIGMA_PX, _LEAST_SIGMA_PX = 0.1, 0.05  # beyond what modelled edges and contour claim
_ROUNDS = 8
_OUTLIER_SIGMAS = 2.0


@dataclass(frozen=True, eq=False)
class ContourLimb:
    """The limb as the glow's contour draws it.

    keep : mask (N,) of the profiles whose glow could be followed. offset_px, sigma_px (N,) : place
    of the limb along their normals, and its one sigma. coherent_px : error that neighbours share.
    """

    keep: np.ndarray
    offset_px: np.ndarray
    sigma_px: float
    coherent_px: float

    def places(self, edges: EdgePlaces) -> EdgePlaces:
        """The edges of the profiles that are kept, moved to where the contour has the limb."""
        kept = edges.take(self.keep)
        offset = self.offset_px[self.keep]
        return replace(kept, offset_px=offset, sigma_px=np.full(len(offset), self.sigma_px))


def contour_limb(
    profiles: np.ndarray,
    d_px: np.ndarray,
    edges: EdgePlaces,
    noise: float,
    along_px: np.ndarray,
    normal_px: np.ndarray,
    pixel_rad: np.ndarray,
    shared_px: float = _EDGE_SIGMA_PX,
) -> ContourLimb | None:
    """Follow the glow's contour along the limb; None where there is no glow to be followed.

    profiles : (N, J) gray levels at d_px (J,) along the normals normal_px (N, 2), of noise `noise`.
    edges : of the planet, as found in the same profiles. along_px, pixel_rad : (N,) their places
    along the limb, in order, and the angle of one pixel there, across it. shared_px : what
    neighbouring edges are off by together, beyond their own sigmas.
    """
    if float(normal_px[0] @ normal_px[-1]) < _TURN:
        return None
    # All in pixels of the same angle: a contour is as high above the limb at the frame's border.
    pitch = pixel_rad / median(pixel_rad)
    edge = edges.offset_px * pitch
    outer_px = d_px[d_px >= median(edge) + _FROM_PX]
    if len(outer_px) < _LEAST_SAMPLES:
        return None
    outer = _at(profiles, d_px, outer_px / pitch[:, None])
    usual = np.median(outer, axis=0)
    glow = usual - usual.min()
    fall, power = -float(glow @ np.gradient(usual)), float(glow @ glow)
    if not fall > 0.0:
        return None
    fading_px = power / fall
    # Near the Sun each profile stands on its own glare, as much as not.
    shape = glow - _OWN_LEVEL * float(glow.mean())
    height = 1.0 + (outer - usual) @ shape / float(shape @ glow)
    misfit = np.sqrt(np.mean(np.square(outer - usual - (height - 1.0)[:, None] * glow), axis=1))
    keep = (height > _FAINTEST) & (height < _BRIGHTEST)
    keep &= misfit < _MAX_MISFIT * max(noise, median(misfit))
    if np.count_nonzero(keep) < _LEAST_PROFILES:
        return None
    # Glow that is brighter by a factor is the same glow farther out.
    contour = fading_px * np.log(np.clip(height, _FAINTEST, _BRIGHTEST))
    own_px = noise * fading_px * float(np.linalg.norm(shape) / (shape @ glow))
    u = 2.0 * (along_px - along_px[0]) / max(float(along_px[-1] - along_px[0]), 1.0) - 1.0
    design = np.stack([np.ones_like(u), u, u * u], axis=1)
    variance = edges.sigma_px**2 + own_px**2 + shared_px**2
    distance, sigma = _smooth(
        contour - edge, np.where(keep, 1.0 / variance, 0.0), design, fading_px
    )
    return ContourLimb(
        keep,
        (contour - distance) / pitch,
        float(np.hypot(own_px, _LEAST_SIGMA_PX)),
        max(sigma[1] / SLOPE_OF_STRETCHES, sigma[2] / BEND_OF_STRETCHES, _LEAST_SIGMA_PX),
    )


def _at(profiles: np.ndarray, d_px: np.ndarray, where_px: np.ndarray) -> np.ndarray:
    """Profiles (N, J) at places (N, K) between their samples, linearly."""
    place = np.clip(where_px - d_px[0], 0.0, len(d_px) - 1.001)
    index = place.astype(np.intp)
    part = place - index
    rows = np.arange(len(profiles))[:, None]
    return np.asarray((1.0 - part) * profiles[rows, index] + part * profiles[rows, index + 1])


def _smooth(
    values: np.ndarray, weight: np.ndarray, design: np.ndarray, fading_px: float
) -> tuple[np.ndarray, np.ndarray]:
    """Quadratic (N,) through values whose bend is limited, robustly; one sigma of its coefficients
    (3,).
    """
    sigma = np.sqrt(1.0 / np.maximum(weight, 1e-12))
    used = weight > 0.0
    slope = 0.0
    now = weight
    for _ in range(_ROUNDS):
        weighted = design * (now / _NEIGHBOURS)[:, None]
        bend2 = (_BEND * fading_px) ** 2 + (_BEND_OF_SLOPE * slope) ** 2
        normal = weighted.T @ design + np.diag([0.0, 0.0, 1.0 / bend2])
        found = np.linalg.solve(normal, weighted.T @ values)
        slope = float(found[1])
        left = (values - design @ found) / sigma
        scale = max(robust_sigma(left[used]), 1.0)
        now = weight / (scale**2 * (1.0 + (left / (_OUTLIER_SIGMAS * scale)) ** 2))
    return design @ found, np.sqrt(np.diag(np.linalg.inv(normal)))
