"""What one pass of refinement looks at: mean profiles across stretches of the predicted limb."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.cameras.white_level import NEAR_WHITE, saturation_level
from horizon_sensor_ros.core.limb.edge.black import Black, black_of, may_be_clipped
from horizon_sensor_ros.core.limb.edge.clipping import clipped, cut_off
from horizon_sensor_ros.core.limb.edge.demosaicing import demosaiced
from horizon_sensor_ros.core.limb.edge.steepest import steepest_fall
from horizon_sensor_ros.core.limb.profiles import (
    Bundles,
    EdgePlaces,
    ProfileGrid,
    pixel_noise,
    pixel_phase,
    pixels_across,
    sample_profiles,
    space_mean,
)
from horizon_sensor_ros.core.limb.texture.grazing import FallingLight, falling_light
from horizon_sensor_ros.core.limb.texture.ground_texture import ground_across_px
from horizon_sensor_ros.core.limb.texture.stretches import INNER_PX, OUTER_PX, Stretches
from horizon_sensor_ros.core.limb_curve import LimbCurve, limb_curve
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.status import Status

MIN_PROFILES = 8
LEAST_SIGNIFICANCE = 5.0  # of an edge: its step over the noise
_OUTER_PX = 6.0  # how far a profile reaches into space, beside the search range
TAPS_PX = 4.0  # beyond its end that interpolation still looks at
_LARGE_PX = 1024  # size of a frame up to which every pixel of limb is sampled
_BUNDLES = 160  # profiles, or means of neighbouring ones, along the limb in a frame
# Length of limb over which the model is given the profiles' mean: what clouds and ground do hardly
# changes along it, and shows through less noise. Short limbs are cut into shorter ones, so that
# there are enough of them for a robust fit; pixels of a frame of `_LARGE_PX`.
_STRETCH_PX = 16.0
_LEAST_STRETCHES = 32
_WHITE_EDGE_PX = -2.0  # from so far inside the predicted edge on, one that is white is looked at
_OF_SPACE, _FAR_OUT = 400, 3  # profiles, whose last samples tell enough of what clips space
_BEYOND_PX = 2.5, 4.0  # outside the predicted edge, where air shows and the lens's blur does not
PLAIN_NOISE = 0.71  # noise of pixels over `pixel_noise`, which allows for an edge's misfits


@dataclass(frozen=True)
class RefinePass:
    """One pass of refinement: what it looks for, and when it is made.

    In pixels of the image, which is reduced by `factor`:
    reach_px, grid_px : edges are sought within +-reach_px of the predicted limb, on such a grid.
    spacing_px : from profile to profile along the limb.
    inner_px : how far a profile reaches into the planet, beside the search range.
    blur_open_px : one sigma of what the blur may differ by along the limb.

    What it does:
    guess : say what the edge may look like, where that was not known.
    at_once : and go on with that guess, if it is that of a sharp edge.
    expected : take the limb to be where it is predicted, as far as is known.
    contour : where air glows, let its contour draw the limb.
    separate_glow : fit limb and glow together, which separates them.
    in_part : do so in a part of the limb where they cannot be fitted in all of it.

    Its place among the passes (`passes.look_for`):
    after_search : the first around a consensus, which may have strayed, in frames that may be too
    large for a soft limb.
    resizes : frames change their size by how it sees their limbs.
    for_glow : it is left out where no edge glows, or the air is known.
    finest : none tells more, where it finds the limb on its cone.
    """

    reach_px: float
    grid_px: float
    spacing_px: float
    factor: int = 1
    guess: bool = True
    at_once: bool = False
    expected: bool = False
    inner_px: float = 6.0
    contour: bool = True
    separate_glow: bool = False
    in_part: bool = False
    blur_open_px: float = 0.0
    after_search: bool = False
    resizes: bool = False
    for_glow: bool = False
    finest: bool = False


@dataclass(frozen=True, eq=False)
class LimbSample:
    """Mean profiles (M, J) of stretches of the limb, across its curve as predicted.

    gray : the image, reduced by `factor`. bundles : of the curve's points, a stretch each.
    spacing_px : between those, and pitch_rad : of a pixel, in that image. noise : one sigma of
    `profiles`, see `pixel_noise`. cornered, corner_px : as of `Stretches`. black : law of space
    where pixels are clipped at zero. blur_open_px : as of `RefinePass`.
    """

    gray: np.ndarray
    factor: int
    curve: LimbCurve
    bundles: Bundles
    grid: ProfileGrid
    spacing_px: float
    pitch_rad: float
    profiles: np.ndarray
    noise: float
    cornered: np.ndarray
    black: Black | None
    blur_open_px: float
    corner_px: float | None
    light: FallingLight | None = None

    @cached_property
    def px(self) -> np.ndarray:
        """Middles (M, 2) of the stretches, pixels of the full image."""
        return self.curve.px[self.bundles.middle]

    @cached_property
    def normal_px(self) -> np.ndarray:
        """Unit normals (M, 2) there, towards space."""
        return self.curve.normal_px[self.bundles.middle]

    @property
    def stretch_px(self) -> float:
        """Length of limb of a stretch, in that image."""
        return self.spacing_px * self.bundles.size

    @cached_property
    def base(self) -> np.ndarray:
        """As of `Stretches` (M, 3)."""
        normal_px = self.normal_px
        base = np.empty((len(normal_px), 3))
        base[:, :2] = normal_px
        base[:, 2] = 1.0
        return base

    def levelled(self, good: np.ndarray) -> LimbSample:
        """With light that falls inwards from the limb made up for, where it does; good : (M,)
        stretches that show an edge.
        """
        # What is too bright for the exposure does not show by how much.
        if self.profiles.max() >= NEAR_WHITE * self.white:
            return self
        light = falling_light(self.profiles, self.grid, self.noise, self.base, good)
        if light is None:
            return self
        return replace(self, profiles=self.profiles + light.lacking(self.grid.d_px), light=light)

    def stretches(self, psf_px: float, rho_rad: float) -> Stretches:
        """Profiles of an edge of a known blur, on a limb of a known radius, as they are kriged."""
        return Stretches(
            profiles=self.profiles,
            d_px=self.grid.d_px,
            noise=PLAIN_NOISE * self.noise,
            psf_px=psf_px,
            length_px=self.stretch_px,
            px_over_radius=ground_across_px(self.pitch_rad, rho_rad),
            base=self.base,
            cornered=self.cornered,
            blur_open_px=self.blur_open_px,
            corner_px=self.corner_px,
        )

    @cached_property
    def steepest(self) -> EdgePlaces:
        """Edges (M,) where brightness falls most steeply."""
        return steepest_fall(self.profiles, self.noise, self.grid)

    @cached_property
    def steps(self) -> tuple[np.ndarray, np.ndarray]:
        """Gray levels (M,) from space to just inside the predicted limb, and which show an edge."""
        samples, num_inside = self.profiles.T, round(-self.grid.first_px)
        inside = samples[num_inside - 2] + samples[num_inside - 1]
        step = 0.5 * inside - (samples[-3] + samples[-2] + samples[-1]) / 3.0
        return step, step > LEAST_SIGNIFICANCE * self.noise

    def light_beyond(self, good: np.ndarray) -> float:
        """Light just beyond the predicted edge, less that far out, over one sigma of its noise, in
        the mean of stretches good (M,).
        """
        d_px, profiles = self.grid.d_px, self.profiles[good]
        near = profiles[:, (d_px >= _BEYOND_PX[0]) & (d_px <= _BEYOND_PX[1])]
        far = profiles[:, -_FAR_OUT:]
        sigma = PLAIN_NOISE * self.noise * math.sqrt(1.0 / near.size + 1.0 / far.size)
        return float(near.mean() - far.mean()) / sigma

    @cached_property
    def white(self) -> float:
        """`saturation_level` of the image."""
        return saturation_level(self.gray, self.profiles)

    @cached_property
    def demosaiced(self) -> bool:
        """Whether the image is a whole frame that was interpolated from colours, and saturated."""
        return self.factor == 1 and self.white < np.inf and demosaiced(self.gray, self.white)

    @cached_property
    def clipped(self) -> np.ndarray:
        """Stretches (M,) that are saturated beside the predicted limb."""
        found = clipped(
            self.profiles,
            self.grid.d_px,
            self.white,
            reduced=self.factor > 1,
            demosaiced=lambda: self.demosaiced,
        )
        if not found.any():
            return found
        edges = self.bundles.index[np.repeat(found, self.bundles.count)]
        d_px = self.grid.d_px[self.grid.d_px >= _WHITE_EDGE_PX]
        levels = pixels_across(self.gray, self.curve, edges, d_px, self.factor)
        if cut_off(levels, self.white, self.noise * math.sqrt(self.bundles.size)):
            return found
        return np.zeros_like(found)

    def moved(self, limb: np.ndarray) -> LimbSample:
        """Profiles as they are kriged, about the curve moved along its normals by (3,), as
        `Stretches.base` has it.
        """
        normal = self.curve.normal_px
        shift = normal @ limb[:2] + limb[2]
        curve = replace(self.curve, px=self.curve.px + (self.factor * shift)[:, None] * normal)
        grid = replace(self.grid, first_px=-INNER_PX, num=round(INNER_PX + OUTER_PX) + 1)
        sampled, _ = sample_profiles(self.gray, curve, grid.d_px, self.factor)
        profiles = self.bundles.mean(sampled)
        if self.black is not None:
            profiles = self.black.unclipped(profiles)
        light = None if self.light is None else self.light.about(limb)
        if light is not None:
            profiles = profiles + light.lacking(grid.d_px)
        return replace(self, curve=curve, grid=grid, profiles=profiles, light=light)

    def phase(self) -> np.ndarray:
        """Means (M, 3) of `pixel_phase`."""
        return self.bundles.mean(pixel_phase(self.curve, self.factor))


def thinning(gray: np.ndarray) -> int:
    """How many pixels of limb of an image (H, W) go to a profile, where one does in a small frame.

    Every pixel of a long limb would cost more than it adds: the edge's texture spans many.
    """
    return max(1, round(max(gray.shape) / _LARGE_PX))


def sample_limb(
    gray: np.ndarray,
    view: CameraView,
    nadir_base: np.ndarray,
    rho_rad: float,
    step: RefinePass,
    *,
    modelled: bool,
) -> LimbSample | LimbPoints:
    """Sample the limb where it is predicted; no limb, and why, where it cannot be looked at.

    gray : (H, W), reduced by ``step.factor``. nadir_base, rho_rad : (3,) and radius of its cone.
    modelled : the edge's look is known, so that profiles are given to a model.
    """
    spacing_px = step.spacing_px * thinning(gray)
    curve = limb_curve(view, nadir_base, rho_rad, spacing_px=spacing_px * step.factor)
    if len(curve) < MIN_PROFILES:
        return LimbPoints.none(Status.NO_LIMB, "the limb is not in the frame")
    first = -(step.reach_px + step.inner_px)
    num = round(2 * step.reach_px + step.inner_px + _OUTER_PX) + 1
    grid = ProfileGrid(first, num, step.reach_px, step.grid_px)
    profiles, valid = sample_profiles(gray, curve, grid.d_px, step.factor)
    num_valid = int(np.count_nonzero(valid))
    if num_valid < MIN_PROFILES:
        return LimbPoints.none(Status.NO_LIMB, "the limb runs along the frame's border")
    if view.mask is not None:
        valid &= view.mask.clear(curve.px, (TAPS_PX - first) * step.factor)
        num_valid = int(np.count_nonzero(valid))
        if num_valid < MIN_PROFILES:
            return LimbPoints.none(Status.NO_LIMB, "the limb is behind the mask")
    bundles = Bundles.of(valid, _profiles_together(len(curve), num_valid, step, modelled))
    if len(bundles) < MIN_PROFILES:
        return LimbPoints.none(Status.NO_LIMB, "the limb runs along the frame's border")
    profiles = bundles.mean(profiles)
    pitch_rad = step.factor * view.camera.pixel_rad
    noise = pixel_noise(profiles, bundles.size)
    black = None
    if step.factor == 1 and may_be_clipped(space_mean(profiles), noise * math.sqrt(bundles.size)):
        some = bundles.index[:: max(1, num_valid // _OF_SPACE)]
        # Nearer to the edge its foot may be what is not black.
        black = black_of(pixels_across(gray, curve, some, grid.d_px[-_FAR_OUT:]).ravel())
    if black is not None:
        profiles = black.unclipped(profiles)
        noise = max(noise, black.sigma / math.sqrt(bundles.size))
    return LimbSample(
        gray=gray,
        factor=step.factor,
        curve=curve,
        bundles=bundles,
        grid=grid,
        spacing_px=spacing_px,
        pitch_rad=pitch_rad,
        profiles=profiles,
        noise=noise,
        cornered=view.camera.cornered(curve.px[bundles.middle]),
        black=black,
        blur_open_px=step.blur_open_px,
        corner_px=None if view.corner_blur_px is None else view.corner_blur_px / step.factor,
    )


def _profiles_together(num: int, num_valid: int, step: RefinePass, modelled: bool) -> int:
    """How many neighbouring profiles of `num` are given as one: they see the same edge, and their
    mean says as much as they do, for a part of the work.
    """
    size = num / _BUNDLES
    if modelled:
        size = max(size, min(_STRETCH_PX / step.spacing_px, num_valid / _LEAST_STRETCHES))
    return max(1, min(round(size), num_valid // MIN_PROFILES))
