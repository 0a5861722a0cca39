"""Step three: the limb to a small part of a pixel, along the normal of the predicted limb."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.camera import CameraView
from horizon_sensor_ros.core.fits.limb_rays import rays_of
from horizon_sensor_ros.core.limb.edge.clipping import place_clipped_edges
from horizon_sensor_ros.core.limb.edge.looks import (
    CLEAR_SHARE,
    USUAL_PSF_PX,
    guess_looks,
    likeliest_look,
)
from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.edge.places import place_edges
from horizon_sensor_ros.core.limb.edge.steepest import steepest_fall
from horizon_sensor_ros.core.limb.glow.contour import contour_limb
from horizon_sensor_ros.core.limb.glow.limb import fit_glow, usual_length_px
from horizon_sensor_ros.core.limb.points import LimbPoints, SharedError
from horizon_sensor_ros.core.limb.profiles import EdgePlaces, ProfileGrid, scatter_px
from horizon_sensor_ros.core.limb.sample import (
    LEAST_SIGNIFICANCE,
    MIN_PROFILES,
    LimbSample,
    RefinePass,
    sample_limb,
)
from horizon_sensor_ros.core.limb.texture.fitted_limb import fitted_limb
from horizon_sensor_ros.core.limb.texture.kriged_limb import KrigedLimb
from horizon_sensor_ros.core.robust import median
from horizon_sensor_ros.core.status import Status

_MAX_MISFIT = 6.0
_EXPECTED_SHARE = 0.9  # of the profiles that show an edge, the least to be as expected
_MODEL_SHARE = 0.7  # of the edges found without a model, the least share that must follow it
# So sharp an edge shows itself otherwise wherever it falls in the pixels, which kriging takes for
# texture; beside ground as even as this there is none to take out.
_FINE_PSF_PX, _EVEN = 0.6, 0.006
_STRETCHES = 6
_APART_SHARE = 0.75  # of what separates two kinds of edge along the limb, as measured beside truth
_CALM, _CALM_PX = 3.0, 0.2  # jumps from profile to profile: over those without a model, and at all
# Jumps of the steepest fall from which on texture moves it, and no cone that fits it is near enough
# to krige about.
_STEADY_PX = 0.05
_MOVED_PX = 0.5
_LEAST_FALL = 0.5  # of brightness at an edge, over the steepest in the profile
_THINNEST_PX = 0.3  # length over which glow fades, from which it may be told from the blur
_LONGEST_CONTOUR_PX = 4.0  # over which glow fades: longer, and a profile's end is not yet space
# Error that neighbours share, by whether air glows and whether edges were placed without a model:
# the scatter, beyond noise, of whole stretches of simulated limbs about the true ones.
_COHERENT_PX = {
    (False, True): 0.1,
    (True, False): 0.2,
    (True, True): 0.4,
}
# Longer glow goes with ground that is seen finer: length from where on that error grows with it,
# and by how much at most, as measured in the same way.
_FINE_PX, _FINEST = 2.0, 2.5
# Where glow is overexposed as well it is taken for ground: error of simulated limbs' height, over
# the length over which glow fades.
_CLIPPED_HEIGHT = 0.6
_SHIFT = 1.5  # error of a camera's whole limb, over that of its stretches, where air glows


def refine_limb(
    gray: np.ndarray,
    view: CameraView,
    nadir_base: np.ndarray,
    rho_rad: float,
    step: RefinePass,
    looks: Sequence[EdgeLook] = (),
) -> tuple[LimbPoints, tuple[EdgeLook, ...]]:
    """Measure the limb near its predicted place in one image.

    gray : (H, W) uint8 or uint16, already reduced by ``step.factor``; pixels of the result are
    those of the full image. looks : what the edge may look like, as returned by the pass before;
    of several the likeliest is chosen. Without any the place of steepest fall is taken.
    Returns the limb and the look of its edge: after a pass without one, guesses or nothing; nothing
    where a given one does not hold. Too few significant edges: status NO_LIMB, and no looks.
    """
    cone = nadir_base, rho_rad
    joined = step.joint
    if joined and len(looks) == 1 and looks[0].air is not None:
        joint = _with_glow(gray, step.factor, view, cone, looks[0])
        if joint is not None:
            return joint
        # The next frame's fit begins anew.
        joined, looks = False, (replace(looks[0], air=None),)
    sample = sample_limb(gray, view, *cone, step, modelled=bool(looks) or step.at_once)
    if isinstance(sample, LimbPoints):
        return sample, ()
    near = None
    if step.expected and len(looks) == 1 and looks[0].glow_px == 0.0:
        followed = _as_expected(sample, looks[0], rho_rad)
        if followed is not None:
            return followed, tuple(looks)
    profiles, grid, noise = sample.profiles, sample.grid, sample.noise
    px, normal_px = sample.px, sample.normal_px
    places = steepest = steepest_fall(profiles, noise, grid)
    good = _believable(places)
    model_free = True
    shared = SharedError(0.0, 0.0)
    clipped = sample.clipped()
    num_good = int(np.count_nonzero(good))
    if step.at_once and num_good >= MIN_PROFILES:
        looks = guess_looks(profiles[good], grid.d_px, places.take(good), CLEAR_SHARE)
        if any(look.glow_px > 0.0 for look in looks):
            return LimbPoints.none(
                Status.NO_LIMB, "the edge is soft, or the air above it glows"
            ), ()
    if looks and num_good >= MIN_PROFILES:
        plain = good & ~clipped
        enough = np.count_nonzero(plain) >= MIN_PROFILES
        shown = profiles[plain if enough else good]
        jumps_px = scatter_px(places.offset_px[good])
        # Whether air glows is asked before; what else the edge looks like the joint fit finds out.
        perhaps = joined and any(look.glow_px > 0.0 for look in looks)
        for climb in (False, True) if perhaps and len(looks) > 1 else (True,):
            look = likeliest_look(shown, noise, looks, grid, climb=climb)
            if joined and look.glow_px > 0.0:
                joint = _with_glow(gray, step.factor, view, cone, look, jumps_px)
                if joint is not None:
                    return joint
        looks = (look,)
        sharp = look.glow_px == 0.0
        kriged = KrigedLimb(sample, look, rho_rad)
        kriging = sharp and enough and _to_be_kriged(look, places.step[plain])
        if kriging and jumps_px < _STEADY_PX and not step.expected:
            near, shared = kriged.about_prediction(good)
        likely = place_edges(profiles, noise, look, grid) if near is None else near
        fits = _believable(likely)
        # A model that most of the edges do not follow, that makes them jump about, or that without
        # glow moves them all, is wrong.
        calm = max(_CALM * jumps_px, _CALM_PX)
        moved = median((likely.offset_px - places.offset_px)[good])
        if (
            np.count_nonzero(fits) > _MODEL_SHARE * num_good
            and scatter_px(likely.offset_px[fits]) < calm
            and (not sharp or abs(moved) < _MOVED_PX)
        ):
            places, good, model_free = likely, fits, False
            if kriging and near is None:
                limb = fitted_limb(kriged.base[good], places.offset_px[good], places.sigma_px[good])
                places, shared = kriged.about(limb, good)
                good = _believable(places)
    if joined and looks and model_free and looks[0].glow_px == 0.0:
        # From far away air is as thin as the blur, and no edge quite looks like either.
        thin = EdgeLook(USUAL_PSF_PX, usual_length_px(view, rho_rad, step.factor))
        if thin.glow_px > _THINNEST_PX:
            jumps_px = scatter_px(places.offset_px[good])
            joint = _with_glow(gray, step.factor, view, cone, thin, jumps_px)
            if joint is not None:
                return joint
    of_clipping = SharedError(0.0, 0.0)
    if clipped.any() and not any(look.glow_px > 0 for look in looks):
        places, of_clipping = _with_clipped(sample, clipped, places)
        good = (good & ~clipped) | (clipped & _believable(places))
    num_good = int(np.count_nonzero(good))
    if num_good < MIN_PROFILES:
        reason = f"{num_good} of {len(profiles)} profiles across the limb show an edge"
        return LimbPoints.none(Status.NO_LIMB, reason), ()
    apart = (places.offset_px - steepest.offset_px)[good & _believable(steepest)]
    jumps_px = scatter_px(steepest.offset_px[good])
    if num_good < len(profiles):
        places, profiles = places.take(good), profiles[good]
        px, normal_px = px[good], normal_px[good]
    given = bool(looks)
    if step.guess and not given:
        looks = guess_looks(profiles, grid.d_px, places)
    glows = any(look.glow_px > 0 for look in looks)
    modelled = not glows and not model_free
    coherent = shared.coherent_px if modelled else _COHERENT_PX[(glows, model_free)]
    if model_free and not glows:
        coherent = min(coherent, scatter_px(places.offset_px))
    if glows and not model_free and len(apart) >= MIN_PROFILES:
        # Where model and steepest fall move apart along the limb, the model does not hold.
        middles = [median(part) for part in np.array_split(apart, _STRETCHES)]
        coherent = max(coherent, _APART_SHARE * float(np.std(middles)))
    if glows:
        long = usual_length_px(view, rho_rad, step.factor) / _FINE_PX
        coherent *= min(max(1.0, long), _FINEST)
    glow_px = max((look.glow_px for look in looks), default=0.0)
    if step.contour and 0.0 < glow_px <= _LONGEST_CONTOUR_PX:
        along = sample.bundles.middle[good]
        pixel_rad = _pixel_rad(view, px, normal_px)
        # Edges without a model lie the farther out, the darker the ground.
        alike = {"shared_px": coherent} if model_free else {}
        contour = contour_limb(
            profiles, grid.d_px, places, noise, along, normal_px, pixel_rad, **alike
        )
        if contour is not None:
            coherent = contour.coherent_px
            places = contour.places(places)
            px, normal_px = px[contour.keep], normal_px[contour.keep]
    if not modelled:
        shared = SharedError(coherent, _SHIFT * coherent)
    points = _points(sample, px, normal_px, places, shared.besides(of_clipping), jumps_px)
    if given and model_free and not glows:
        points = replace(points, modelled=False)
    if glows:
        height_px = _CLIPPED_HEIGHT * float(np.mean(clipped)) * usual_length_px(view, rho_rad)
        points = replace(points, height_px=height_px)
    return points, () if given and model_free else tuple(looks)


def _as_expected(sample: LimbSample, look: EdgeLook, rho_rad: float) -> LimbPoints | None:
    """Limb of a sharp edge that is where it was predicted, and all of it; None if it is not.

    Nothing is asked of the steepest fall, and edges are not placed one by one.
    """
    step, good = sample.steps()
    if np.count_nonzero(good) < MIN_PROFILES or not _to_be_kriged(look, step[good]):
        return None
    if sample.clipped().any():
        return None
    places, shared = KrigedLimb(sample, look, rho_rad).about_prediction(good, followed=True)
    if places is None:
        return None
    fits = _believable(places)
    num_fits = int(np.count_nonzero(fits))
    if num_fits < max(_EXPECTED_SHARE * np.count_nonzero(good), MIN_PROFILES):
        return None
    profiles, px, normal_px = sample.profiles, sample.px, sample.normal_px
    if num_fits < len(fits):
        profiles, px, normal_px = profiles[fits], px[fits], normal_px[fits]
        places = places.take(fits)
    jumps_px = scatter_px(places.offset_px)
    if not (jumps_px < _CALM_PX and _falls_there(profiles, sample.grid)):
        return None
    return _points(sample, px, normal_px, places, shared, jumps_px)


def _falls_there(profiles: np.ndarray, grid: ProfileGrid) -> bool:
    """Whether all along the limb profiles (N, J) fall where the edge is predicted.

    Around a limb that lies elsewhere kriging takes what is missing for texture.
    """
    falls = profiles[:, :-1] - profiles[:, 1:]
    falls = np.add.reduceat(falls, np.arange(_STRETCHES) * len(falls) // _STRETCHES)
    here = round(-grid.first_px)
    there = falls[:, here - 1 : here + 1].max(axis=1)
    return bool((there > _LEAST_FALL * falls.max(axis=1)).all())


def _with_clipped(
    sample: LimbSample, clipped: np.ndarray, places: EdgePlaces
) -> tuple[EdgePlaces, SharedError]:
    """Places with those of clipped edges (M,) as their feet tell them, and the error they share."""
    found = place_clipped_edges(
        sample.profiles[clipped], sample.grid.d_px, sample.white, sample.noise, sample.grid.reach_px
    )
    # Texture may end beside these edges as it does beside the others.
    sigma_px = np.hypot(found.places.sigma_px, places.sigma_px[clipped])
    by = replace(found.places, sigma_px=sigma_px)
    share = float(np.mean(clipped))
    coherent, shift = (share * error for error in found.shared)
    return places.replaced(clipped, by), SharedError(coherent, shift)


def _points(
    sample: LimbSample,
    px: np.ndarray,
    normal_px: np.ndarray,
    places: EdgePlaces,
    shared: SharedError,
    jumps_px: float,
) -> LimbPoints:
    """Limb points (N,) in the full image, of edges near px (N, 2); the rest in pixels of the
    sample's.
    """
    factor = sample.factor
    offset_px = places.offset_px * factor
    return LimbPoints(
        Status.OK,
        "",
        px + offset_px[:, None] * normal_px,
        normal_px,
        places.sigma_px * factor,
        shared.coherent_px * factor,
        shared.shift_px * factor,
        sample.stretch_px * factor,
        jumps_px * factor,
        sample.curve,
        offset_px,
    )


def _to_be_kriged(look: EdgeLook, step: np.ndarray) -> bool:
    """Whether kriging is for a sharp edge with such steps (N,) along it."""
    return look.psf_px >= _FINE_PSF_PX or _unevenness(step) > _EVEN


def _with_glow(
    gray: np.ndarray,
    factor: int,
    view: CameraView,
    cone: tuple[np.ndarray, float],
    look: EdgeLook,
    jumps_px: float = np.inf,
) -> tuple[LimbPoints, tuple[EdgeLook, ...]] | None:
    """Points of the limb near a predicted cone, fitted together with the glow above it, and the
    look with its air.
    """
    joint = fit_glow(gray, view, *cone, look, factor)
    if joint is None:
        return None
    points = LimbPoints(
        Status.OK,
        "",
        joint.px,
        joint.normal_px,
        np.full(len(joint.px), joint.sigma_px * factor),
        joint.coherent_px * factor,
        joint.shift_px * factor,
        joint.stretch_px * factor,
        jumps_px * factor,
        joint.curve,
        cov_cone=joint.cov_cone,
    )
    points = replace(points, offset_px=rays_of(view, points).residuals_px(*cone))
    return points, (replace(look, air=joint.air),)


def _unevenness(step: np.ndarray) -> float:
    """One robust sigma of steps (N,) from one profile to the next, over the step."""
    return scatter_px(step) / median(step)


def _pixel_rad(view: CameraView, px: np.ndarray, normal_px: np.ndarray) -> np.ndarray:
    """Angles (N,) of one pixel along the normals."""
    rays = view.camera.rays(np.concatenate([px, px + normal_px]))
    apart = rays[len(px) :] - rays[: len(px)]
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", apart, apart)))


def _believable(places: EdgePlaces) -> np.ndarray:
    return (
        (places.significance > LEAST_SIGNIFICANCE)
        & ~places.at_border
        & (places.misfit < _MAX_MISFIT)
    )
