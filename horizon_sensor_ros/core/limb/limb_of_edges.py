"""The limb of edges that are found one by one along it, and what they are off by together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb.edge.clipping import place_clipped_edges
from horizon_sensor_ros.core.limb.edge.darkening import darkening_error
from horizon_sensor_ros.core.limb.edge.looks import guess_looks
from horizon_sensor_ros.core.limb.edge.model import PSF_LADDER_PX, EdgeLook
from horizon_sensor_ros.core.limb.edge.places import place_edges
from horizon_sensor_ros.core.limb.edge.terminator import beside_over_deep, fading_ends
from horizon_sensor_ros.core.limb.glow.contour import ContourLimb, contour_limb
from horizon_sensor_ros.core.limb.glow.limb import usual_length_px
from horizon_sensor_ros.core.limb.glow.white_air import PART_TURNS, of_white_air
from horizon_sensor_ros.core.limb.kriged_limb import KrigedLimb
from horizon_sensor_ros.core.limb.profiles import (
    EdgePlaces,
    ProfileGrid,
    pixel_rad_across,
    scatter_px,
    space_mean,
)
from horizon_sensor_ros.core.limb.sample import (
    LEAST_SIGNIFICANCE,
    MIN_PROFILES,
    LimbSample,
    RefinePass,
)
from horizon_sensor_ros.core.limb.texture.fitted_limb import fitted_limb
from horizon_sensor_ros.core.limb.texture.ground_texture import ground_across_px
from horizon_sensor_ros.core.limb_points import (
    NOTHING_SHARED,
    CornerBlur,
    LimbPoints,
    SharedError,
)
from horizon_sensor_ros.core.mathematics.robust import median, medians, starts_of_parts
from horizon_sensor_ros.core.status import Status

_MAX_MISFIT = 6.0
_EXPECTED_SHARE = 0.9  # of the profiles that show an edge, the least to be as expected
_MODEL_SHARE = 0.7  # of the edges found without a model, the least share that must follow it
# So sharp an edge shows itself otherwise wherever it falls in the pixels, which kriging takes for
# texture; beside ground as even as this there is none to take out.
_FINE_PSF_PX, _EVEN = 0.6, 0.006
_STRETCHES = 6
_MOVED_SHARE = 0.75  # of what a model moves stretches by unequally, as measured beside truth
_CALM, _CALM_PX = 3.0, 0.2  # jumps from profile to profile: over those without a model, and at all
# Jumps of the steepest fall from which on texture moves it, and no cone that fits it is near enough
# to krige about.
_STEADY_PX = 0.05
_MOVED_PX = 0.5
# Steepest falls so steady are moved by texture up to .34 px along simulated limbs at rest; where a
# model moves some of them farther the blur is not the same along the limb, as motion makes it.
_DRIFT_PX = 0.4
_LEAST_FALL = 0.5  # of brightness at an edge, over the steepest in the profile
_LEAST_LEVEL = 0.25  # of brightness at an edge of a followed limb, over the step there
_STEP_PX = 3  # from so far inside the predicted edge on its step is seen
_LONGEST_CONTOUR_PX = 4.0  # over which glow fades: longer, and a profile's end is not yet space
# Error that neighbours share, by whether air glows and whether edges were placed without a model:
# the scatter, beyond noise, of whole stretches of simulated limbs about the true ones.
_COHERENT_PX = {
    (False, True): 0.1,
    (True, False): 0.2,
    (True, True): 0.4,
}
# An edge as sharp as the sharpest modelled one may be sharper, and then lies beside where the model
# has it: as measured of simulated lenses without blur, so much of pixels alone.
_TOO_SHARP = SharedError(0.02, 0.05)
# Longer glow goes with ground that is seen finer: length from where on that error grows with it,
# and by how much at most, as measured in the same way.
_FINE_PX, _FINEST = 2.0, 2.5
# Where glow changes too fast along a limb to be fitted with it its contour is no more of a limb:
# errors of simulated ones towards the terminator and beside the Sun, over the other limbs'.
_UNEVEN_GLOW = 1.5
# What neighbouring edges share of their errors in light that falls inwards, whose law is fitted to
# three of them together.
_ALIKE_IN_LIGHT = 0.5
# Errors of a camera's whole limb and of its ends, over that of its stretches, where air glows or no
# model fits.
_SHIFT, _SLOPE = 1.5, 0.7


@dataclass(frozen=True, eq=False)
class LimbEdges:
    """Edges of a limb, each by itself. good : (M,), which to believe. model_free : they are where
    brightness falls most steeply, not where a model of the edge lies. corner_blur : as of
    `KrigedPlaces`.
    """

    places: EdgePlaces
    good: np.ndarray
    model_free: bool = True
    shared: SharedError = NOTHING_SHARED
    corner_blur: CornerBlur | None = None

    @cached_property
    def jumps_px(self) -> float:
        """By how much those differ from one to the next, one sigma."""
        return scatter_px(self.places.offset_px[self.good])


def modelled_edges(
    sample: LimbSample, look: EdgeLook, steepest: LimbEdges, rho_rad: float, step: RefinePass
) -> LimbEdges | None:
    """Edges placed by a model of them, and kriged where they are sharp enough for it.

    None where the model is wrong: too few edges follow it (`_MODEL_SHARE`); it makes neighbouring
    edges jump (`_CALM`); or, without glow, it moves all edges (`_MOVED_PX`), or a whole stretch of
    edges that lie steadily (`_DRIFT_PX`), away from where brightness falls most steeply.
    """
    places, good = steepest.places, steepest.good
    plain = good & ~sample.clipped
    sharp = look.glow_px == 0.0
    jumps_px = steepest.jumps_px
    kriged = KrigedLimb(sample, look, rho_rad)
    enough = np.count_nonzero(plain) >= MIN_PROFILES
    kriging = sharp and enough and _to_be_kriged(look, places.step[plain])
    found = None
    if kriging and jumps_px < _STEADY_PX and not step.expected:
        found = kriged.about_prediction(good)
    if found is None:
        likely = place_edges(sample.profiles, sample.noise, look, sample.grid)
    else:
        likely = found.places
    fits = believable(likely)
    moved = median((likely.offset_px - places.offset_px)[good])
    if (
        np.count_nonzero(fits) <= _MODEL_SHARE * np.count_nonzero(good)
        or not scatter_px(likely.offset_px[fits]) < max(_CALM * jumps_px, _CALM_PX)
        or (sharp and not abs(moved) < _MOVED_PX)
    ):
        return None
    if kriging and found is None:
        limb = fitted_limb(kriged.base[fits], likely.offset_px[fits], likely.sigma_px[fits])
        found = kriged.about(limb, fits, _there(likely) & ~fits)
        likely = found.places
        fits = believable(likely)
    if sharp and jumps_px < _STEADY_PX and _drift_px(likely, places, good & fits) > _DRIFT_PX:
        return None
    if found is None:
        return LimbEdges(likely, fits, False, _of_sharpness(steepest.shared, look))
    return LimbEdges(likely, fits, False, _of_sharpness(found.shared, look), found.corner_blur)


def _of_sharpness(shared: SharedError, look: EdgeLook) -> SharedError:
    """Error that edges share, with that of a model which is not sharp enough for them."""
    return shared.besides(_TOO_SHARP) if look.psf_px <= PSF_LADDER_PX[0] else shared


def _drift_px(moved: EdgePlaces, places: EdgePlaces, good: np.ndarray) -> float:
    """By how much good edges (M,) are moved, in the stretch of limb where it is most; infinite
    where kriging left none.
    """
    moved_px = (moved.offset_px - places.offset_px)[good]
    if len(moved_px) == 0:
        return np.inf
    return max(map(abs, medians(moved_px, min(_STRETCHES, len(moved_px)))))


def limb_of_edges(
    sample: LimbSample,
    edges: LimbEdges,
    steepest: EdgePlaces,
    looks: Sequence[EdgeLook],
    view: CameraView,
    rho_rad: float,
    step: RefinePass,
    *,
    uneven: bool,
) -> tuple[LimbPoints, tuple[EdgeLook, ...]]:
    """Limb of edges found one by one, and looks as `refine_limb` returns them.

    steepest : where brightness falls most steeply. uneven : glow is known to change fast along it.
    """
    given = bool(looks)
    places, good, of_clipping = _lasting(sample, edges, looks)
    places, of_light = _in_falling_light(sample, places, good)
    if np.count_nonzero(good) < MIN_PROFILES:
        reason = f"{np.count_nonzero(good)} of {len(good)} profiles across the limb show an edge"
        return LimbPoints.none(Status.NO_LIMB, reason), ()
    edges_px = places.offset_px
    jumps_px = scatter_px(steepest.offset_px[good])
    taken = _Taken.of(sample, places, good)
    if step.guess and not given:
        looks = guess_looks(taken.profiles, sample.grid.d_px, taken.places)
    glow_px = max((look.glow_px for look in looks), default=0.0)
    glows = glow_px > 0.0
    shared = edges.shared
    if glows or edges.model_free:
        moved_px = (edges_px - steepest.offset_px)[good & believable(steepest)]
        length_px = usual_length_px(view, rho_rad, step.factor)
        moved_px = None if edges.model_free else moved_px
        coherent = _coherent_px(taken.places, glow_px, length_px, moved_px)
        if step.contour and 0.0 < glow_px <= _LONGEST_CONTOUR_PX:
            # Edges without a model lie the farther out, the darker the ground.
            shared_px = coherent if edges.model_free else None
            contour = _contour(sample, good, taken, view, shared_px)
            if contour is not None:
                coherent = contour.coherent_px
                taken = taken.along(contour)
        if uneven:
            coherent *= _UNEVEN_GLOW
        shared = SharedError(coherent, _SHIFT * coherent, _SLOPE * coherent)
    shared = shared.besides(of_clipping).besides(of_light)
    no_model = given and edges.model_free
    if glows:
        points = _points(sample, taken, shared, jumps_px)
        along_rad = len(taken.px) * sample.stretch_px * sample.pitch_rad
        share, length_px = float(np.mean(sample.clipped)), usual_length_px(view, rho_rad)
        by_white = of_white_air(share, along_rad, rho_rad, length_px)
        points = replace(points, shared=points.shared.besides(by_white))
    else:
        look = None if edges.model_free else looks[0]
        points = _points_without_glow(
            sample, taken, shared, jumps_px, look, rho_rad, edges.corner_blur
        )
        if no_model:
            points = replace(points, modelled=False)
    return points, () if no_model else tuple(looks)


@dataclass(frozen=True, eq=False)
class _Taken:
    """Edges (N,) of which limb points are made.

    profiles : (N, J) in which they are. px, normal_px : (N, 2) where these cross the predicted
    limb, pixels of the full image, and their directions. places : of the edges.
    """

    profiles: np.ndarray
    px: np.ndarray
    normal_px: np.ndarray
    places: EdgePlaces

    @classmethod
    def of(cls, sample: LimbSample, places: EdgePlaces, good: np.ndarray) -> _Taken:
        """Of a sample's edges (M,) those that are good."""
        if good.all():
            return cls(sample.profiles, sample.px, sample.normal_px, places)
        px, normal_px = sample.px[good], sample.normal_px[good]
        return cls(sample.profiles[good], px, normal_px, places.take(good))

    def along(self, contour: ContourLimb) -> _Taken:
        """Those of them that a contour of the glow could follow, where it has the limb."""
        keep, places = contour.keep, contour.places(self.places)
        return _Taken(self.profiles[keep], self.px[keep], self.normal_px[keep], places)

    @cached_property
    def falls(self) -> np.ndarray:
        """By how much brightness falls from sample to sample, in stretches of limb: (S, J - 1)."""
        first = starts_of_parts(len(self.profiles), _STRETCHES)
        sums = np.add.reduceat(self.profiles.T, first, axis=1).T
        return np.asarray(sums[:, :-1] - sums[:, 1:])


def _in_falling_light(
    sample: LimbSample, places: EdgePlaces, good: np.ndarray
) -> tuple[EdgePlaces, SharedError]:
    """Places of edges (M,), and what good ones share, with what `FallingLight` leaves open."""
    if sample.light is None or not good.any():
        return places, NOTHING_SHARED
    sigma_px = sample.light.sigma_px
    coherent_px = float(np.sqrt(np.mean(np.square(sigma_px[good]))))
    places = replace(places, sigma_px=np.hypot(places.sigma_px, sigma_px))
    return places, SharedError(_ALIKE_IN_LIGHT * coherent_px)


def _of_limb(sample: LimbSample, step: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Which of good edges (M,) lie where the planet ends, not at an end where its light does.

    step : (M,) as of `EdgePlaces`.
    """
    if good.all():
        of_limb = ~fading_ends(sample.profiles, sample.grid, step)
    else:
        where = np.flatnonzero(good)
        of_limb = good.copy()
        of_limb[where] = ~fading_ends(sample.profiles[where], sample.grid, step[where])
    if sample.light is not None:
        of_limb &= ~sample.light.faded(good)
    return of_limb


def _contour(
    sample: LimbSample,
    good: np.ndarray,
    taken: _Taken,
    view: CameraView,
    shared_px: float | None,
) -> ContourLimb | None:
    """Contour of the glow above the edges that were taken; good : (M,) which of the sample's.

    shared_px : as of `contour_limb`, by default if None.
    """
    alike = {} if shared_px is None else {"shared_px": shared_px}
    return contour_limb(
        taken.profiles,
        sample.grid.d_px,
        taken.places,
        sample.noise,
        sample.bundles.middle[good],
        taken.normal_px,
        pixel_rad_across(view, taken.px, taken.normal_px),
        **alike,
    )


def _lasting(
    sample: LimbSample, edges: LimbEdges, looks: Sequence[EdgeLook]
) -> tuple[EdgePlaces, np.ndarray, SharedError]:
    """As `_with_feet`, good without those at ends where light fades."""
    places, good, shared = _with_feet(sample, edges, looks)
    # Until looks are known light beyond the edges may be air's, which fades otherwise.
    if looks and all(look.glow_px == 0.0 for look in looks):
        good = _of_limb(sample, places.step, good)
    return places, good, shared


def _with_feet(
    sample: LimbSample, edges: LimbEdges, looks: Sequence[EdgeLook]
) -> tuple[EdgePlaces, np.ndarray, SharedError]:
    """Places of edges (M,), which of them are good, and the error that clipped ones share: without
    glow these are placed by their feet.
    """
    clipped = sample.clipped
    if not clipped.any() or any(look.glow_px > 0 for look in looks):
        return edges.places, edges.good, NOTHING_SHARED
    # One lens blurs them all.
    shown = not edges.model_free and np.count_nonzero(edges.good & ~clipped) >= MIN_PROFILES
    blur_px = looks[0].psf_px if shown else None
    places, shared = _with_clipped(sample, clipped, edges.places, blur_px)
    return places, (edges.good & ~clipped) | (clipped & believable(places)), shared


def _coherent_px(
    places: EdgePlaces, glow_px: float, length_px: float, moved_px: np.ndarray | None
) -> float:
    """Error that neighbouring edges share where air glows, so far up, or no model places them.

    glow_px : length over which the glow fades, 0 without any, and length_px : over which air
    usually does. moved_px : (N,) how far a model moves edges from the steepest fall, along the
    limb; None without a model.
    """
    coherent_px = _COHERENT_PX[(glow_px > 0.0, moved_px is None)]
    if glow_px == 0.0:
        return min(coherent_px, scatter_px(places.offset_px))
    if moved_px is not None and len(moved_px) >= MIN_PROFILES:
        # Where these differ along the limb, the model does not hold.
        middles = medians(moved_px, _STRETCHES)
        coherent_px = max(coherent_px, _MOVED_SHARE * float(np.std(middles)))
    return coherent_px * min(max(1.0, length_px / _FINE_PX), _FINEST)


def expected_limb(sample: LimbSample, look: EdgeLook, rho_rad: float) -> LimbPoints | None:
    """Limb of a sharp edge that is where it was predicted, and all of it; None if it is not.

    Nothing is asked of the steepest fall, and edges are not placed one by one.
    """
    step, good = sample.steps
    good = _of_limb(sample, step, good)
    if np.count_nonzero(good) < MIN_PROFILES or not _to_be_kriged(look, step[good]):
        return None
    if sample.clipped.any():
        return None
    found = KrigedLimb(sample, look, rho_rad).about_prediction(good, followed=True)
    if found is None:
        return None
    places = found.places
    fits = _of_limb(sample, places.step, believable(places))
    places, of_light = _in_falling_light(sample, places, fits)
    if np.count_nonzero(fits) < max(_EXPECTED_SHARE * np.count_nonzero(good), MIN_PROFILES):
        return None
    taken = _Taken.of(sample, places, fits)
    jumps_px = scatter_px(taken.places.offset_px)
    if not (jumps_px < _CALM_PX and _falls_there(taken.falls, sample.grid)):
        return None
    if not _lit_there(taken, sample.grid):
        return None
    shared = _of_sharpness(found.shared, look).besides(of_light)
    return _points_without_glow(sample, taken, shared, jumps_px, look, rho_rad, found.corner_blur)


def _points_without_glow(
    sample: LimbSample,
    taken: _Taken,
    shared: SharedError,
    jumps_px: float,
    look: EdgeLook | None,
    rho_rad: float,
    corner_blur: CornerBlur | None,
) -> LimbPoints:
    """As `_points`, with what shows besides where no air glows.

    shared : but for what darkening ground adds. look : by which edges were placed; None without a
    model. corner_blur : in pixels of the sample's image.
    """
    grid, factor = sample.grid, sample.factor
    darkening = darkening_error(
        taken.profiles,
        grid,
        taken.places.step,
        ground_across_px(sample.pitch_rad, rho_rad),
        model_free=look is None,
    )
    return _points(
        sample,
        taken,
        shared.besides(darkening),
        jumps_px,
        steepness=_steepness(taken.falls, grid),
        blur_px=np.nan if look is None else factor * look.psf_px,
        corner_blur=None if corner_blur is None else corner_blur.times(factor),
        beside_over_deep=beside_over_deep(taken.profiles, grid),
    )


def _falls_there(falls: np.ndarray, grid: ProfileGrid) -> bool:
    """Whether all along the limb brightness falls where the edge is predicted.

    Around a limb that lies elsewhere kriging takes what is missing for texture.
    """
    there = _falls_at(falls, grid)
    return bool((there > _LEAST_FALL * falls.max(axis=1)).all())


def _lit_there(taken: _Taken, grid: ProfileGrid) -> bool:
    """Whether all along the limb edges lie where it is about half as bright as beside the limb.

    Kriged about a prediction that lies in space the dark below it is texture's, and the limb is
    where it was predicted.
    """
    profiles, places = taken.profiles, taken.places
    at = places.offset_px - grid.first_px
    before = at.astype(np.intp)
    share = at - before
    row = np.arange(len(at))
    level = (1.0 - share) * profiles[row, before] + share * profiles[row, before + 1]
    first = starts_of_parts(len(at), _STRETCHES)
    lit = np.add.reduceat(level - space_mean(profiles), first)
    return bool((lit > _LEAST_LEVEL * np.add.reduceat(places.step, first)).all())


def _steepness(falls: np.ndarray, grid: ProfileGrid) -> np.ndarray:
    """`LimbPoints.steepness` (S,) of falls (S, J - 1)."""
    step = falls[:, round(-grid.first_px) - _STEP_PX :].sum(axis=1)
    return _falls_at(falls, grid) / np.maximum(step, 1e-9)


def _falls_at(falls: np.ndarray, grid: ProfileGrid) -> np.ndarray:
    """Steepest fall (S,) beside the predicted edge."""
    here = round(-grid.first_px)
    return np.asarray(falls[:, here - 1 : here + 1].max(axis=1))


def _with_clipped(
    sample: LimbSample, clipped: np.ndarray, places: EdgePlaces, shown_blur_px: float | None
) -> tuple[EdgePlaces, SharedError]:
    """Places with those of clipped edges (M,) as their feet tell them, and the error they share.

    shown_blur_px : as of `place_clipped_edges`.
    """
    found = place_clipped_edges(
        sample.profiles[clipped],
        sample.grid.d_px,
        sample.white,
        sample.noise,
        sample.grid.reach_px,
        shown_blur_px,
        demosaiced=sample.demosaiced,
    )
    # Texture may end beside these edges as it does beside the others.
    sigma_px = np.hypot(found.places.sigma_px, places.sigma_px[clipped])
    by = replace(found.places, sigma_px=sigma_px)
    share = float(np.mean(clipped))
    # A part of a limb that is off, and the rest not, turns it: by the slope of a line fitted to
    # both, the part at one end, as it is where brightness grows along the limb.
    turned_px = PART_TURNS * share * (1.0 - share) * found.shared.shift_px
    return places.replaced(clipped, by), found.shared.times(share)._replace(slope_px=turned_px)


def _points(
    sample: LimbSample, taken: _Taken, shared: SharedError, jumps_px: float, **besides: Any
) -> LimbPoints:
    """Limb points (N,) in the full image of edges in a sample of it; shared, jumps_px : in pixels
    of the sample's. besides : further fields of the points.
    """
    factor, places = sample.factor, taken.places
    offset_px = places.offset_px * factor
    return LimbPoints(
        Status.OK,
        px=taken.px + offset_px[:, None] * taken.normal_px,
        normal_px=taken.normal_px,
        sigma_px=places.sigma_px * factor,
        shared=shared.times(factor),
        spacing_px=sample.stretch_px * factor,
        jumps_px=jumps_px * factor,
        predicted=sample.curve,
        offset_px=offset_px,
        factor=factor,
        step=places.step,
        **besides,
    )


def _to_be_kriged(look: EdgeLook, step: np.ndarray) -> bool:
    """Whether kriging is for a sharp edge with such steps (N,) along it."""
    return look.psf_px >= _FINE_PSF_PX or _unevenness(step) > _EVEN


def _unevenness(step: np.ndarray) -> float:
    """One robust sigma of steps (N,) from one profile to the next, over the step."""
    return scatter_px(step) / median(step)


def believable(places: EdgePlaces) -> np.ndarray:
    """Which edges (M,) are significant, not at the end of their profile, and of low misfit."""
    return _there(places) & (places.misfit < _MAX_MISFIT)


def _there(places: EdgePlaces) -> np.ndarray:
    """Which edges (M,) are significant, and not at the end of their profile."""
    return (places.significance > LEAST_SIGNIFICANCE) & ~places.at_border
