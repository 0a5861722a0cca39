"""What is seen along the normals of a limb under glowing air, and how high above it that passes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.cameras.white_level import saturation_level
from horizon_sensor_ros.core.fits.limb_rays import rays_of
from horizon_sensor_ros.core.limb.profiles import Bundles, pixel_noise, sample_profiles
from horizon_sensor_ros.core.limb.sample import PLAIN_NOISE, TAPS_PX, thinning
from horizon_sensor_ros.core.limb.texture.ground_texture import ground_across_px
from horizon_sensor_ros.core.limb_curve import LimbCurve, limb_curve
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.status import Status

INNER_PX = 4.0  # how far profiles reach into the planet
_STRETCH_PX, _MOST_STRETCHES = 24.0, 27
LEAST_STRETCHES = 10  # of limb, that a fit takes
_BENT = 0.1  # change of glare that is no line's, over the line's
# What `GlowSight` has of each stretch.
_BY_STRETCH = (
    "profiles",
    "blind",
    "px",
    "normal_px",
    "rows",
    "distance",
    "rise",
    "cornered",
    "glare",
    "glare_variance",
)
_SATURATED, _SATURATED_SHARE = 0.98, 0.02  # of white; of a stretch's samples


@dataclass(frozen=True, eq=False)
class GlowSight:
    """What M stretches of limb look like across a cone, in an image reduced by `factor`.

    Sampled : curve : points along the limb. bundles : of these points, one a stretch. stretch_px :
    length of limb of each.
    Seen : d_px : (J,) places across the limb, whole pixels outwards. profiles : (M, J) mean gray
    levels there. blind : (M, J) where samples are saturated. noise : one sigma of the others.
    glare : (M, 2) straight line, level at the limb and slope a pixel outwards, that has been taken
    off the profiles as the Sun's glare; glare_variance : (M, J) error that this left.
    Geometry : px, normal_px : (M, 2) middles of the stretches in the full image, and normals there,
    towards space. rows : (M, 3) by how much the limb moves outwards, pixels per radian, with
    nadir's two tangent components and rho. rise : (M,) height of the first pixel above the limb,
    over the planet's radius. distance : (M, J) heights of the samples above the limb in units of
    `rise`; below the limb d_px itself. cornered : (M,) squares of the distances to the optical
    axis, over half the frame's diagonal. px_over_radius : ground across one pixel along the limb,
    over the planet's radius.
    """

    curve: LimbCurve
    bundles: Bundles
    factor: int
    d_px: np.ndarray
    profiles: np.ndarray
    blind: np.ndarray
    noise: float
    px: np.ndarray
    normal_px: np.ndarray
    rows: np.ndarray
    distance: np.ndarray
    rise: np.ndarray
    cornered: np.ndarray
    px_over_radius: float
    stretch_px: float
    glare: np.ndarray
    glare_variance: np.ndarray

    def __len__(self) -> int:
        return len(self.profiles)

    @property
    def along(self) -> np.ndarray:
        """Place (M,) of each stretch along the limb, -1 to 1."""
        return np.linspace(-1.0, 1.0, len(self))

    def moved(self, gray: np.ndarray, shift_px: np.ndarray) -> GlowSight:
        """Sample the same stretches about a limb that lies shift_px (M,) farther out, a pixel or so
        at most.
        """
        every = np.interp(np.arange(len(self.curve)), self.bundles.middle, self.factor * shift_px)
        normal_px = self.curve.normal_px
        curve = replace(self.curve, px=self.curve.px + every[:, None] * normal_px)
        sampled, _ = sample_profiles(gray, curve, self.d_px, self.factor)
        profiles, blind = _means(gray, sampled, self.bundles)
        if self.glare.any():
            profiles -= self.glare[:, :1] + self.glare[:, 1:] * (shift_px[:, None] + self.d_px)
        px = self.px + (self.factor * shift_px)[:, None] * self.normal_px
        return replace(self, curve=curve, profiles=profiles, blind=blind, px=px)

    def part(self, first: float, last: float) -> GlowSight:
        """The stretches from one place to another, 0 to 1 along the limb, as if it ended there."""
        which = slice(round(first * len(self)), round(last * len(self)))
        bundles = self.bundles.part(which)
        every = slice(bundles.index[0], bundles.index[-1] + 1)
        curve = self.curve
        curve = replace(curve, px=curve.px[every], normal_px=curve.normal_px[every])
        bundles = replace(bundles, index=bundles.index - bundles.index[0])
        rows = {name: getattr(self, name)[which] for name in _BY_STRETCH}
        return replace(self, curve=curve, bundles=bundles, **rows)

    def without_glare(self, glare: np.ndarray, from_px: float, outer_px: float) -> GlowSight:
        """Sight up to outer_px above the limb, without a glare that is seen beyond from_px.

        glare : (M, 2), its gray level at the limb, and by how much that grows a pixel outwards.
        """
        near = self.d_px <= outer_px
        d_px = self.d_px[near]
        return replace(
            self,
            d_px=d_px,
            profiles=self.profiles[:, near] - glare[:, :1] - glare[:, 1:] * d_px,
            blind=self.blind[:, near],
            distance=self.distance[:, near],
            glare=glare,
            glare_variance=np.square(_BENT * glare[:, 1:] * (from_px - d_px)),
        )


def look_along(
    gray: np.ndarray,
    view: CameraView,
    nadir_base: np.ndarray,
    rho_rad: float,
    outer_px: float,
    factor: int,
) -> GlowSight | None:
    """Sample the limb of a cone as far as outer_px above it; None where too little is in sight.

    gray : (H, W), reduced by `factor`; outer_px : in its pixels.
    """
    spacing_px = float(thinning(gray))
    curve = limb_curve(view, nadir_base, rho_rad, spacing_px=spacing_px * factor)
    d_px = np.arange(-INNER_PX, outer_px + 0.5)
    if len(curve) < 2:
        return None
    sampled, valid = sample_profiles(gray, curve, d_px, factor)
    if view.mask is not None:
        valid &= view.mask.clear(curve.px, (outer_px + TAPS_PX) * factor)
    num = int(np.count_nonzero(valid))
    size = max(round(_STRETCH_PX / spacing_px), math.ceil(num / _MOST_STRETCHES))
    bundles = Bundles.of(valid, size)
    if num < 2 * size:
        return None
    profiles, blind = _means(gray, sampled, bundles)
    px, normal_px = curve.px[bundles.middle], curve.normal_px[bundles.middle]
    middles = LimbPoints(Status.OK, "", px, normal_px, np.ones(len(px)))
    limb = rays_of(view, middles)
    at = px[:, None] + (factor * d_px)[:, None] * normal_px[:, None]
    rays = view.camera.rays(at.reshape(-1, 2)) @ (view.rot_base_from_cam.T @ nadir_base)
    if len(limb) != len(px) or not np.isfinite(rays).all():
        return None
    sine = np.sqrt(np.maximum(1.0 - rays * rays, 0.0)).reshape(profiles.shape)
    height = sine / math.sin(rho_rad) - 1.0
    middle = int(INNER_PX)
    rise = 0.5 * (height[:, middle + 1] - height[:, middle - 1])
    # Above the horizontal sight passes no air at all; as low as the limb again, no fit is of it.
    if not (rise > 0.0).all() or (height[:, d_px > 0.0] < 0.0).any():
        return None
    growth = limb.angles(nadir_base)[1] * factor
    return GlowSight(
        curve=curve,
        bundles=bundles,
        factor=factor,
        d_px=d_px,
        profiles=profiles,
        blind=blind,
        noise=PLAIN_NOISE * pixel_noise(profiles, size),
        px=px,
        normal_px=normal_px,
        rows=-limb.design(nadir_base, tangent_basis(nadir_base)) / growth[:, None],
        distance=np.where(d_px > 0.0, height / rise[:, None], d_px),
        rise=rise,
        cornered=view.camera.cornered(px),
        px_over_radius=ground_across_px(factor * view.camera.pixel_rad, rho_rad),
        stretch_px=spacing_px * size,
        glare=np.zeros((len(px), 2)),
        glare_variance=np.zeros(profiles.shape),
    )


def _means(
    gray: np.ndarray, sampled: np.ndarray, bundles: Bundles
) -> tuple[np.ndarray, np.ndarray]:
    """Means of profiles (N, J), and which of them (M, J) are of saturated samples."""
    profiles = bundles.mean(sampled).astype(np.float64)
    white = _SATURATED * saturation_level(gray, sampled)
    if white == np.inf:
        return profiles, np.zeros(profiles.shape, dtype=bool)
    return profiles, bundles.mean((sampled >= white).astype(np.float32)) > _SATURATED_SHARE
