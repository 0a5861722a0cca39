"""Whether to believe a frame's limb, a fit, or two cameras that say different things."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from horizon_sensor_ros.core.covariance.shared_error import bend_px
from horizon_sensor_ros.core.fits.assessment import MIN_POINTS, inliers, root_mean_square
from horizon_sensor_ros.core.fits.maximum_likelihood import METHOD
from horizon_sensor_ros.core.fits.observation import LimbObservation, gather
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.limb.evidence import SkyEvidence
from horizon_sensor_ros.core.limb.haze.column import LOWEST_RHO_RAD
from horizon_sensor_ros.core.mathematics.attitude import angle_rad, tangent_basis
from horizon_sensor_ros.core.mathematics.robust import median
from horizon_sensor_ros.core.mathematics.symmetric3 import largest_eigenvalue
from horizon_sensor_ros.core.status import Status

# Nadirs of two fits contradict each other when they are apart by more than both of these limits.
_DISAGREEMENT_SIGMAS = 5.0
_DISAGREEMENT_RAD = np.radians(0.25)
# An edge is no limb where its stretches lie off the best cone (RMS) by more than this multiple of
# the error that neighbours share (`SharedError.coherent_px`, but for what is overexposed: so much
# is known of that, within a sigma or two), and by more than this many pixels.
_MAX_BEND, _LEAST_BEND_PX = 4.5, 0.75
# Residual of edges that follow no model, over their claimed sigma; beyond it other cones fit too.
_MOST_SCATTER = 1.5
# Residual of one camera's modelled edges over their claimed sigma, and over that with what they
# share: cloud decks, ice, round parts of the craft have edges that are less even than they are
# sharp. Of 2000 simulated single limbs none is beyond both (5.1 and 1.6, and 3.1 and 2.7, come
# nearest), nor are those of real frames (2.8 and 1.5, uncalibrated); of another renderer's 49
# decks of cloud that were taken for a limb 29 are beyond.
_UNEVEN, _UNEVEN_BESIDE_SHARED = 4.0, 2.0
# Who knows nadir so well by itself, one sigma, checks the other cameras.
_KNOWS_RAD = np.radians(0.5)
# Heights of the airglow's edge above a limb: 76 to 99 km in photographs in which that was the
# ground's, 91 to 110 in simulated frames, whose layer is at 95.
_LAYER_HEIGHTS_M = 60e3, 120e3
# Its quartiles are 3 to 20 km apart there, and about another nadir half a degree off and more 28.
_LAYER_SPREAD_M = 25e3
# Lit ground is lit behind its limb too: all but 14 % of it in the darkest of 1400 simulated limbs;
# between a night side's lamps a third or more is dark, and their outermost ones are no limb.
_MOST_DARK_GROUND = 0.25
_MOST_HIDDEN = 0.5  # of the limb, that a part of the craft accounts for
# A cone through banks of cloud inside the limb left 24 % (by moonlight, one camera of 2900); of
# 1900 right ones of every kind, by haze, daylight, glare, airglow, beside booms, one more than 20.
_MOST_GROUND_BEYOND = 0.2
# Edges on which the search agreed lie on the limb, but for 4 % beside the worst of 2100 right ones
# without glow; a bank of cloud at one end of a short arc, taken for the limb, leaves 19 % and more
# of them outside.
_MOST_OUTSIDE = 0.1
# Above a limb that one camera sees by itself air fades within 1.7 times the Earth's usual length in
# all of 129 simulated ones; where it seems to fade over 4 and more the edge is a bank of cloud's,
# and the glow dark ground behind it.
_MOST_GLOW = 3.0


def doubt(
    evidence: SkyEvidence,
    found_px: float,
    space_share: float,
    left_outside: float,
    config: HorizonConfig,
    *,
    sky_hidden: bool = False,
) -> str:
    """Why a frame's limb points are not the limb's; empty when nothing speaks against them.

    found_px : length of limb along which edges were found. space_share : gray level of empty space,
    over the largest gray level. left_outside : share of the edges on which the search agreed that
    lie outside of the limb. sky_hidden : what is bright in the sky is known to be a part of the
    craft, which also hides the limb beside it.
    """
    hidden = min(evidence.bright_sky, _MOST_HIDDEN) if sky_hidden else 0.0
    lit_px = max(evidence.limb_px * evidence.lit_limb * (1.0 - hidden), 1.0)
    if space_share > config.max_space_level:
        return f"no dark sky: the darkest part of the frame is at {space_share:.0%} of full scale"
    if evidence.contrast < config.min_contrast:
        return f"faint limb: {evidence.contrast:.0f} sigma above space"
    in_the_sky = "" if sky_hidden else _in_the_sky(evidence, config)
    if in_the_sky:
        return in_the_sky
    if evidence.dark_ground > _MOST_DARK_GROUND:
        return f"lights, not a limb: {evidence.dark_ground:.0%} of the ground behind them is dark"
    if found_px < config.min_limb_share * lit_px:
        return f"an edge along {found_px / lit_px:.0%} of the limb only"
    if left_outside > _MOST_OUTSIDE:
        return f"cloud, not a limb: {left_outside:.0%} of the edges of space lie outside of it"
    return ""


def _in_the_sky(evidence: SkyEvidence, config: HorizonConfig) -> str:
    """`doubt` by what is where the sky should be: ground, or a part of the craft."""
    if evidence.bright_sky > config.max_bright_sky:
        return f"bright sky beside {evidence.bright_sky:.0%} of the limb"
    if evidence.clear_sky < config.min_clear_sky:
        return f"only {evidence.clear_sky:.0%} of the sky is at the level of space"
    if evidence.ground_beyond > _MOST_GROUND_BEYOND:
        return f"ground shows beyond {evidence.ground_beyond:.0%} of the limb"
    return ""


def refusal(
    fit: HorizonFit,
    observations: Sequence[LimbObservation],
    config: HorizonConfig,
    *,
    alone: Sequence[HorizonFit] = (),
    layered: bool = False,
    layer_m: tuple[float, float, float] | None = None,
    glow_over_usual: float = 0.0,
    estimate: HorizonFit | None = None,
) -> tuple[Status, str] | None:
    """Why a fit is not to be published, or None.

    fit : of the frames alone; the shape of the edges is judged by its cone. estimate : what is to
    be published, where it contains more than the frames (airglow, a known altitude); altitude and
    sigma are judged by it. By default the fit.
    alone : fits of those cameras that determine a cone by themselves; their edges are judged by
    that cone, since what cameras contradict each other by is in the covariance. layered : a layer
    of airglow was found at the same distance all along the limb, which proves that it is a limb.
    layer_m : quartiles of its edge's height, None if it was not measured. glow_over_usual : largest
    `Detection.glow_over_usual` of the cameras used.
    Returns status and reason, for a person.
    """
    estimate = fit if estimate is None else estimate
    return (
        _of_altitude(estimate, observations, layer_m, config)
        or _of_residual(fit, observations, config)
        or _of_edges(fit, observations, alone, layered, config)
        or _of_glow(fit, glow_over_usual)
        or _of_sigma(estimate, config)
        or _of_cameras(fit, observations)
    )


def _of_altitude(
    estimate: HorizonFit,
    observations: Sequence[LimbObservation],
    layer_m: tuple[float, float, float] | None,
    config: HorizonConfig,
) -> tuple[Status, str] | None:
    """`refusal` by where the airglow and the camera would be."""
    if layer_m is not None:
        low, middle, high = layer_m
        would_be = "not the ground's limb: the airglow above it would be"
        if not _LAYER_HEIGHTS_M[0] < middle < _LAYER_HEIGHTS_M[1]:
            return Status.POOR_FIT, f"{would_be} {middle / 1e3:.0f} km high"
        if high - low > _LAYER_SPREAD_M:
            return Status.POOR_FIT, f"{would_be} {low / 1e3:.0f} to {high / 1e3:.0f} km high"
    lowest_m = _lowest_m(estimate, observations, config)
    if not lowest_m <= estimate.altitude_m <= config.altitude_max_m:
        return (
            Status.ALTITUDE_OUT_OF_RANGE,
            f"altitude {estimate.altitude_m / 1e3:.0f} km is outside "
            f"{config.altitude_min_m / 1e3:.0f} to {config.altitude_max_m / 1e3:.0f} km",
        )
    return None


def _lowest_m(
    estimate: HorizonFit, observations: Sequence[LimbObservation], config: HorizonConfig
) -> float:
    """Altitude that an estimate may have at least."""
    # A limb in air that hides the ground lies so much above it, and the camera may too; but a soft
    # straight edge of the craft's looks to one camera as such a limb does to a very low one.
    above_m = max((seen.limb.above_m for seen in observations), default=0.0)
    if above_m == 0.0 or len(estimate.cameras) < 2:
        return config.altitude_min_m
    lowest_m = config.altitude_min_m - max(above_m - config.planet.limb_height_m, 0.0)
    return max(lowest_m, config.planet.altitude_from_rho(LOWEST_RHO_RAD))


def _of_residual(
    fit: HorizonFit, observations: Sequence[LimbObservation], config: HorizonConfig
) -> tuple[Status, str] | None:
    """`refusal` by how far points lie off the cone; larger frames may have more pixels of it."""
    width = max(observation.view.camera.width for observation in observations)
    limit_px = config.max_residual_px * max(1.0, width / 640.0)
    if not fit.rms_residual_px <= limit_px:
        return Status.POOR_FIT, f"residual {fit.rms_residual_px:.2f} px, above {limit_px:.2f}"
    return None


def _of_edges(
    fit: HorizonFit,
    observations: Sequence[LimbObservation],
    alone: Sequence[HorizonFit],
    layered: bool,
    config: HorizonConfig,
) -> tuple[Status, str] | None:
    """`refusal` by edges that bend, or scatter, as no limb's do."""
    uneven, knowing, even = [], 0, False
    for observation in observations if fit.method == METHOD else ():
        if observation.view.name not in fit.cameras:
            continue
        one = _by_itself(observation, alone)
        held = _to_be_held(observation, fit)
        bends = _bends(observation, one or fit) if held else ""
        if bends:
            return Status.POOR_FIT, bends
        uneven.append(_uneven(observation, fit, one, config) if held and not layered else "")
        if one is not None and nadir_sigma_rad(one) <= _KNOWS_RAD:
            knowing += 1
            even |= not uneven[-1]
    # Two that know nadir by themselves check each other, and an even one checks the others; but two
    # pieces of edges that are no limb's bear out any common cone.
    why = next(filter(None, uneven), "")
    checked = len(fit.cameras) > 1 and (even or knowing > 1)
    return (Status.POOR_FIT, why) if why and not checked else None


def _uneven(
    observation: LimbObservation, fit: HorizonFit, one: HorizonFit | None, config: HorizonConfig
) -> str:
    """Why a camera's edge is too uneven for a limb; empty if it is not. one : fit of that alone."""
    name, limb = observation.view.name, observation.limb
    rays = gather([observation])
    rms_px = (one or fit).rms_residual_px
    if one is None and len(fit.cameras) > 1:
        residual = rays.residuals_px(fit.nadir_base, fit.rho_rad)
        rms_px = root_mean_square(residual[inliers(residual)])
    sigma_px = median(rays.sigma_px)
    scatter = rms_px / sigma_px
    if not limb.modelled and scatter > _MOST_SCATTER:
        return f"the edge in {name} follows no model of one, and hardly a limb"
    shared_px = math.hypot(sigma_px, limb.shared.coherent_px)
    uneven = scatter > _UNEVEN and rms_px > _UNEVEN_BESIDE_SHARED * shared_px
    if limb.modelled and uneven and config.limb_unevenness_m == 0.0:
        return (
            f"the edge in {name} is {scatter:.1f} times as uneven as it is sharp: cloud, ice, "
            "a part of the craft, or mountains (limb_unevenness)?"
        )
    return ""


def _of_glow(fit: HorizonFit, glow_over_usual: float) -> tuple[Status, str] | None:
    """`refusal` of one camera by how far out its glow reaches."""
    if glow_over_usual > _MOST_GLOW and len(fit.cameras) < 2:
        return (
            Status.POOR_FIT,
            f"cloud, not a limb: what glows beyond the edge in {fit.cameras[0]} fades over "
            f"{glow_over_usual:.0f} times the length of air",
        )
    return None


def _of_sigma(estimate: HorizonFit, config: HorizonConfig) -> tuple[Status, str] | None:
    """`refusal` by how well nadir is known."""
    sigma = nadir_sigma_rad(estimate)
    if not sigma <= config.max_nadir_sigma_rad:
        return Status.UNCERTAIN, f"nadir is known to {np.degrees(sigma):.2g} deg only"
    return None


def _of_cameras(
    fit: HorizonFit, observations: Sequence[LimbObservation]
) -> tuple[Status, str] | None:
    """`refusal` of several cameras by a limb that lies off their common cone."""
    if len(fit.cameras) < 2:
        return None
    for observation in observations:
        rays = gather([observation])
        if len(rays) == 0:
            continue
        residual = rays.residuals_px(fit.nadir_base, fit.rho_rad)
        spread = np.hypot(fit.rms_residual_px, rays.sigma_px)
        if np.mean(np.abs(residual) < 4.0 * spread) < 0.5:
            # A limb that is turned against it lies off it both ways.
            off_px = root_mean_square(residual)
            return (
                Status.CAMERAS_DISAGREE,
                f"the limb in {observation.view.name} lies {off_px:.1f} px off the common cone",
            )
    return None


def bends_by_itself(
    fit: HorizonFit, observations: Sequence[LimbObservation], alone: Sequence[HorizonFit]
) -> dict[int, str]:
    """Observations whose edge is no limb even by the cone of its own camera, by index, and why.

    alone : as of `refusal`. Empty where this is so of all cameras of the fit: `refusal` then
    refuses the fit.
    """
    bent = {}
    for i, observation in enumerate(observations):
        cone = _by_itself(observation, alone)
        if cone is not None and _to_be_held(observation, fit):
            bends = _bends(observation, cone)
            if bends:
                bent[i] = bends
    return bent if len(bent) < len(fit.cameras) else {}


def _by_itself(observation: LimbObservation, alone: Sequence[HorizonFit]) -> HorizonFit | None:
    """Fit of a camera by itself, if it determines a cone."""
    return next((one for one in alone if one.cameras == (observation.view.name,)), None)


def _to_be_held(observation: LimbObservation, fit: HorizonFit) -> bool:
    """Whether a camera's edges are of a fit, and lie off its cone by more than their own errors."""
    return (
        observation.limb.shared.coherent_px > 0.0
        and len(gather([observation])) >= MIN_POINTS
        and observation.view.name in fit.cameras
    )


def _bends(observation: LimbObservation, cone: HorizonFit) -> str:
    """Why a camera's edges are no limb's, by how they lie to a cone; empty if they may be."""
    bend = bend_px(cone, gather([observation]))
    shared = observation.limb.shared
    unexplained_px = math.sqrt(max(shared.coherent_px**2 - shared.white_px**2, 0.0))
    if not bend > max(_MAX_BEND * unexplained_px, _LEAST_BEND_PX):
        return ""
    return f"the edge in {observation.view.name} bends unlike a limb, by {bend:.2f} px"


def disagreement_rad(one: HorizonFit, other: HorizonFit) -> float | None:
    """Angle between two fits' nadirs if it is more than their covariances allow, else None."""
    apart_rad = angle_rad(one.nadir_base, other.nadir_base)
    cov = (one.cov_nadir_altitude + other.cov_nadir_altitude)[:3, :3]
    if apart_rad > 0.5 * math.pi:
        # The tangent plane ends here: opposite nadirs are one point of it.
        chi2 = apart_rad**2 / largest_eigenvalue(cov)
    else:
        basis = tangent_basis(one.nadir_base)
        apart = basis.T @ (other.nadir_base - one.nadir_base)
        chi2 = float(apart @ np.linalg.solve(basis.T @ cov @ basis, apart))
    unlikely = chi2 > _DISAGREEMENT_SIGMAS**2
    return apart_rad if unlikely and apart_rad > _DISAGREEMENT_RAD else None


def nadir_sigma_rad(fit: HorizonFit) -> float:
    """One sigma of nadir in its least certain direction."""
    return math.sqrt(largest_eigenvalue(fit.cov_nadir_altitude[:3, :3]))
