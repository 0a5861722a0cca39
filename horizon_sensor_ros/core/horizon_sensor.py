"""The whole horizon chain: simultaneous frames of N cameras in, nadir and altitude out, or the
reason why not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from horizon_sensor_ros.core.attitude import tangent_basis
from horizon_sensor_ros.core.camera import CameraView
from horizon_sensor_ros.core.fits import METHODS, fit_horizon
from horizon_sensor_ros.core.fits.assessment import covariance_nadir_altitude
from horizon_sensor_ros.core.fits.limb_rays import gather
from horizon_sensor_ros.core.fits.result import HorizonFit, LimbObservation
from horizon_sensor_ros.core.limb.candidates import reduce_image
from horizon_sensor_ros.core.limb.detector import Detection, canny_limbs, detect_limb
from horizon_sensor_ros.core.limb.evidence import SkyEvidence, sky_evidence
from horizon_sensor_ros.core.limb.points import LimbPoints
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

LIMB_SOURCES = ("subpixel", "canny")
# The sphere that stands in for an ellipsoid whose orientation is not known: worst latitude and
# heading, short arcs in low orbit, one sigma (0.24 deg at most).
_ELLIPSOID_SIGMA_RAD = np.radians(0.1)
_STRETCHES = 6
_CAMERA_SHIFT = 1.5  # error of a camera's whole limb, over that of its stretches
_ELLIPSOID_ALTITUDE_SIGMA_M = 10.7e3  # half of the polar flattening
# Two cameras that see the limb each for itself contradict each other when farther apart than both.
_DISAGREEMENT_SIGMAS = 5.0
_DISAGREEMENT_RAD = np.radians(0.25)


@dataclass(frozen=True)
class Frame:
    """One image and the camera that took it. gray : (H, W) uint8 or uint16."""

    view: CameraView
    gray: np.ndarray


@dataclass(frozen=True)
class HorizonConfig:
    """What the sensor is told once. Raises ValueError for what makes no sense.

    method : one of `METHODS`. limb : `subpixel`, or `canny` (whole pixels, as the four papers).
    planet : the body; for an ellipsoid its mean sphere is fitted, and what that leaves out is in
    the covariance.
    altitude_min_m, altitude_max_m : a disc outside these is no horizon of ours.
    max_nadir_sigma_rad : an estimate less certain than this is withheld.
    max_residual_px : a limb that scatters more than this about the fit, per 640 pixels of image
    width, is withheld.
    min_limb_share : of the limb that should show in a frame (where the planet is lit), the least
    share that must be found. max_bright_sky, min_clear_sky : of the limb and of the sky beyond it,
    see `SkyEvidence`.
    min_contrast : planet over space beside the limb, in sigmas of the reduced image's noise.
    max_space_level : gray level of empty space, over the largest gray level.
    """

    method: str = "ml"
    limb: str = "subpixel"
    planet: Planet = field(default_factory=Planet)
    altitude_min_m: float = 10e3
    altitude_max_m: float = 100e6
    max_nadir_sigma_rad: float = float(np.radians(0.5))
    max_residual_px: float = 1.2
    min_limb_share: float = 0.5
    max_bright_sky: float = 0.25
    min_clear_sky: float = 0.72
    min_contrast: float = 12.0
    max_space_level: float = 0.15

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ValueError(f"method must be one of {', '.join(METHODS)}, got {self.method!r}")
        if self.limb not in LIMB_SOURCES:
            raise ValueError(f"limb must be one of {', '.join(LIMB_SOURCES)}, got {self.limb!r}")
        if not 0.0 < self.altitude_min_m < self.altitude_max_m < np.inf:
            raise ValueError(
                "altitude_min_m must be positive and below altitude_max_m, got "
                f"{self.altitude_min_m} and {self.altitude_max_m}"
            )
        if not self.altitude_max_m > self.planet.limb_height_m:
            raise ValueError(
                f"altitude_max_m must be above the limb's height of {self.planet.limb_height_m}, "
                f"got {self.altitude_max_m}"
            )
        for name in ("max_nadir_sigma_rad", "max_residual_px", "min_contrast"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("min_limb_share", "max_bright_sky", "min_clear_sky", "max_space_level"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name} must lie within 0 and 1, got {getattr(self, name)}")


@dataclass(frozen=True)
class HorizonFix:
    """What simultaneous frames told.

    fit : the estimate, NaN when status is not OK. limbs : one per frame, in order; a frame that
    contributed nothing says why. cameras_used : names of those that did.
    """

    status: Status
    reason: str
    fit: HorizonFit
    limbs: tuple[LimbPoints, ...]
    cameras_used: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """True when there is an estimate."""
        return self.status is Status.OK


class HorizonSensor:
    """Frames of any number of cameras to nadir and altitude."""

    def __init__(self, config: HorizonConfig | None = None) -> None:
        self.config = HorizonConfig() if config is None else config
        planet = self.config.planet
        # Without a position an ellipsoid can only be fitted by its mean sphere.
        self._sphere = (
            planet
            if planet.flattening == 0.0
            else Planet(planet.mean_radius_m, planet.limb_height_m)
        )
        self._rho_min = self._sphere.rho_from_altitude(self.config.altitude_max_m)
        # Nothing is seen from below the limb.
        lowest_m = max(self.config.altitude_min_m, planet.limb_height_m)
        self._rho_max = self._sphere.rho_from_altitude(lowest_m)

    def reset(self) -> None:
        """Forget the past. Every set of frames is judged on its own, so there is none yet."""

    def process(self, frames: Sequence[Frame]) -> HorizonFix:
        """Find the horizon in simultaneous frames.

        A camera whose frame shows no trustworthy limb is left out and the others decide; its entry
        in `limbs` says why. Raises ValueError for no frames at all, or an image that is not (H, W)
        uint8 or uint16; a frame of another size than its camera's is refused with status BAD_IMAGE.
        """
        if len(frames) == 0:
            raise ValueError("frames must hold at least one frame")
        limbs: list[LimbPoints | None] = [_unusable(frame) for frame in frames]
        while True:
            rest = [i for i, limb in enumerate(limbs) if limb is None]
            if not rest:
                return _no_fix(frames, limbs)
            fix, doubtful = self._attempt([frames[i] for i in rest])
            if not doubtful:
                for i, limb in zip(rest, fix.limbs, strict=True):
                    limbs[i] = limb
                fix = HorizonFix(
                    fix.status, fix.reason, fix.fit, tuple(_filled(limbs)), fix.cameras_used
                )
                return self._contradicted(frames, fix) or fix
            # What a camera says against itself may have misled the others: once more without it.
            for i, limb in doubtful.items():
                limbs[rest[i]] = limb

    def _contradicted(self, frames: Sequence[Frame], fix: HorizonFix) -> HorizonFix | None:
        """Refusal of one camera's fix where another camera, looked at alone, has a fix elsewhere.

        Where the extrinsics are wrong two good limbs lie on no common cone; the consensus keeps
        one of them, and nothing tells which camera is the one that is mounted as it should be.
        """
        if not fix.ok or len(fix.cameras_used) > 1:
            return None
        for frame, limb in zip(frames, fix.limbs, strict=True):
            if limb.status in (Status.OK, Status.BAD_IMAGE):
                continue
            alone, doubtful = self._attempt([frame])
            if not alone.ok or doubtful:
                continue
            apart = np.linalg.norm(np.cross(alone.fit.nadir_base, fix.fit.nadir_base))
            sigma = np.hypot(_nadir_sigma(alone.fit), _nadir_sigma(fix.fit))
            if apart > max(_DISAGREEMENT_SIGMAS * sigma, _DISAGREEMENT_RAD):
                reason = (
                    f"{frame.view.name} alone finds nadir {np.degrees(apart):.1f} deg "
                    f"from that of {fix.cameras_used[0]}"
                )
                none = HorizonFit.none(
                    Status.CAMERAS_DISAGREE, reason, self.config.method, fix.fit.num_points
                )
                return HorizonFix(none.status, reason, none, fix.limbs, ())
        return None

    def _attempt(self, frames: Sequence[Frame]) -> tuple[HorizonFix, dict[int, LimbPoints]]:
        """One detection and fit; with the frames whose own evidence speaks against it, and why."""
        views = [frame.view for frame in frames]
        images = [frame.gray for frame in frames]
        detection = detect_limb(
            views, images, self._sphere, rho_min_rad=self._rho_min, rho_max_rad=self._rho_max
        )
        limbs = detection.limbs
        if self.config.limb == "canny" and detection.predicted.ok:
            limbs = canny_limbs(views, images, detection.predicted)
        observations = [LimbObservation(v, limb) for v, limb in zip(views, limbs, strict=True)]
        if not any(limb.status is Status.OK for limb in limbs):
            fit = HorizonFit.none(limbs[0].status, limbs[0].reason, self.config.method)
            return HorizonFix(fit.status, _reasons(views, limbs), fit, limbs, ()), {}
        fit = fit_horizon(observations, self._sphere, self.config.method)
        if not fit.ok:
            return HorizonFix(fit.status, fit.reason, fit, limbs, ()), {}
        doubtful = self._doubts(frames, detection, limbs, fit)
        if doubtful:
            return HorizonFix(Status.NO_LIMB, "", fit, limbs, ()), doubtful
        fit = self._with_model_error(fit, observations)
        refusal = self._judge(frames, observations, fit)
        if refusal is not None:
            none = HorizonFit.none(*refusal, self.config.method, fit.num_points)
            return HorizonFix(*refusal, none, limbs, ()), {}
        return HorizonFix(Status.OK, "", fit, limbs, fit.cameras), {}

    def _doubts(
        self,
        frames: Sequence[Frame],
        detection: Detection,
        limbs: Sequence[LimbPoints],
        fit: HorizonFit,
    ) -> dict[int, LimbPoints]:
        """Frames that delivered limb points but whose sky or limb says that they are not the
        limb.
        """
        doubts = {}
        for i, (frame, limb) in enumerate(zip(frames, limbs, strict=True)):
            if limb.status is not Status.OK:
                continue
            candidates = detection.candidates[i]
            small, factor = reduce_image(frame.gray)
            evidence = sky_evidence(
                small,
                factor,
                candidates.space_level,
                candidates.noise,
                frame.view,
                fit.nadir_base,
                fit.rho_rad,
            )
            found_px = len(limb.px) if self.config.limb == "subpixel" else np.inf
            reason = self._doubt(
                evidence, found_px, candidates.space_level / full_scale(frame.gray)
            )
            if reason:
                doubts[i] = LimbPoints.none(Status.NO_LIMB, reason)
        return doubts

    def _doubt(self, evidence: SkyEvidence, found_px: float, space_level: float) -> str:
        config = self.config
        lit_px = max(evidence.limb_px * evidence.lit_limb, 1.0)
        if space_level > config.max_space_level:
            return (
                f"no dark sky: the darkest part of the frame is at {space_level:.0%} of full scale"
            )
        if evidence.contrast < config.min_contrast:
            return f"faint limb: {evidence.contrast:.0f} sigma above space"
        if evidence.bright_sky > config.max_bright_sky:
            return f"bright sky beside {evidence.bright_sky:.0%} of the limb"
        if evidence.clear_sky < config.min_clear_sky:
            return f"only {evidence.clear_sky:.0%} of the sky is at the level of space"
        if found_px < config.min_limb_share * lit_px:
            return f"an edge along {found_px / lit_px:.0%} of the limb only"
        return ""

    def _judge(
        self, frames: Sequence[Frame], observations: Sequence[LimbObservation], fit: HorizonFit
    ) -> tuple[Status, str] | None:
        """Why a fit is not to be trusted, or None."""
        config = self.config
        if not config.altitude_min_m <= fit.altitude_m <= config.altitude_max_m:
            return (
                Status.ALTITUDE_OUT_OF_RANGE,
                f"altitude {fit.altitude_m / 1e3:.0f} km is outside "
                f"{config.altitude_min_m / 1e3:.0f} to {config.altitude_max_m / 1e3:.0f} km",
            )
        width = max(frame.view.camera.width for frame in frames)
        limit_px = config.max_residual_px * max(1.0, width / 640.0)
        if not fit.rms_residual_px <= limit_px:
            return Status.POOR_FIT, f"residual {fit.rms_residual_px:.2f} px, above {limit_px:.2f}"
        sigma = _nadir_sigma(fit)
        if not sigma <= config.max_nadir_sigma_rad:
            return Status.UNCERTAIN, f"nadir is known to {np.degrees(sigma):.2f} deg only"
        for observation in observations:
            rays = gather([observation])
            if len(rays) == 0 or len(fit.cameras) < 2:
                continue
            residual = rays.residuals_px(fit.nadir_base, fit.rho_rad)
            spread = np.hypot(fit.rms_residual_px, rays.sigma_px)
            agree = np.mean(np.abs(residual) < 4.0 * spread)
            if agree < 0.5:
                off = float(np.median(residual))
                return (
                    Status.CAMERAS_DISAGREE,
                    f"the limb in {observation.view.name} lies {off:.1f} px off the common cone",
                )
        return None

    def _with_model_error(
        self, fit: HorizonFit, observations: Sequence[LimbObservation]
    ) -> HorizonFit:
        """Add to the covariance what the points' own scatter cannot show.

        That is the error that stretches of the limb share, and for an ellipsoid what its mean
        sphere leaves out.
        """
        cov = fit.cov_nadir_altitude + _coherent_covariance(fit, observations, self._sphere)
        if self.config.planet.flattening > 0.0:
            across = np.eye(3) - np.outer(fit.nadir_base, fit.nadir_base)
            cov[:3, :3] += _ELLIPSOID_SIGMA_RAD**2 * across
            cov[3, 3] += _ELLIPSOID_ALTITUDE_SIGMA_M**2
        values = {name: getattr(fit, name) for name in fit.__dataclass_fields__}
        return HorizonFit(**{**values, "cov_nadir_altitude": cov})


def _coherent_covariance(
    fit: HorizonFit, observations: Sequence[LimbObservation], sphere: Planet
) -> np.ndarray:
    """Covariance (4, 4) of nadir and altitude from the errors that neighbouring points share.

    Each camera's limb counts as `_STRETCHES` independent stretches, whatever the number of points.
    """
    basis = tangent_basis(fit.nadir_base)
    information = np.zeros((3, 3))
    shifts = []
    for observation in observations:
        rays = gather([observation])
        if len(rays) < 2 * _STRETCHES or observation.view.name not in fit.cameras:
            continue
        claimed_px = observation.limb.coherent_px
        if claimed_px == 0.0:
            return np.zeros((4, 4))
        # What the stretches show of it counts too, more than it seems: the fit has bent to them.
        residual = rays.residuals_px(fit.nadir_base, fit.rho_rad)[rays.along_limb(fit.nadir_base)]
        stretches = [np.median(part) for part in np.array_split(residual, _STRETCHES)]
        freedom = max(1.0 - 3.0 / (_STRETCHES * len(fit.cameras)), 0.25)
        seen_px = np.sqrt(np.mean(np.square(stretches)) / freedom)
        coherent_px = float(max(claimed_px, np.nan_to_num(seen_px, posinf=9.0)))
        rows = rays.design(fit.nadir_base, basis) / rays.angles(fit.nadir_base)[1][:, None]
        weight = _STRETCHES / (len(rays) * coherent_px**2)
        information += weight * rows.T @ rows
        # The limb of a camera as a whole may be off by as much: cameras see different air.
        shifts.append(_CAMERA_SHIFT * claimed_px * weight * rows.sum(axis=0))
    gain = np.linalg.pinv(information, hermitian=True)
    moved = [gain @ shift for shift in shifts]
    cov = gain + sum((np.outer(move, move) for move in moved), np.zeros((3, 3)))
    return covariance_nadir_altitude(cov, basis, fit.rho_rad, sphere)


def full_scale(gray: np.ndarray) -> float:
    """Largest gray level: 255, or for 16-bit images that of the fewest bits (8 to 16) that hold
    the frame's.
    """
    if gray.dtype == np.uint8:
        return 255.0
    return float(2 ** max(8, int(gray.max()).bit_length()) - 1)


def _nadir_sigma(fit: HorizonFit) -> float:
    """One sigma of nadir in its worst direction, radians."""
    return float(np.sqrt(np.linalg.eigvalsh(fit.cov_nadir_altitude[:3, :3])[-1]))


def _unusable(frame: Frame) -> LimbPoints | None:
    gray, camera = frame.gray, frame.view.camera
    if (
        not isinstance(gray, np.ndarray)
        or gray.ndim != 2
        or gray.dtype not in (np.uint8, np.uint16)
    ):
        got = f"{getattr(gray, 'dtype', type(gray))} {getattr(gray, 'shape', '')}"
        raise ValueError(f"gray of {frame.view.name} must be (H, W) uint8 or uint16, got {got}")
    if gray.shape != (camera.height, camera.width):
        return LimbPoints.none(
            Status.BAD_IMAGE,
            f"image of {gray.shape[1]} x {gray.shape[0]}, "
            f"camera of {camera.width} x {camera.height}",
        )
    if min(gray.shape) < 16:
        return LimbPoints.none(
            Status.BAD_IMAGE, f"image of {gray.shape[1]} x {gray.shape[0]} is too small"
        )
    return None


def _no_fix(frames: Sequence[Frame], limbs: Sequence[LimbPoints | None]) -> HorizonFix:
    filled = _filled(limbs)
    reason = _reasons([frame.view for frame in frames], filled)
    fit = HorizonFit.none(filled[0].status, reason, "")
    return HorizonFix(filled[0].status, reason, fit, tuple(filled), ())


def _filled(limbs: Sequence[LimbPoints | None]) -> list[LimbPoints]:
    return [limb or LimbPoints.none(Status.NO_LIMB, "not looked at") for limb in limbs]


def _reasons(views: Sequence[CameraView], limbs: Sequence[LimbPoints]) -> str:
    if len({limb.reason for limb in limbs}) == 1:
        return limbs[0].reason
    return "; ".join(f"{v.name}: {limb.reason}" for v, limb in zip(views, limbs, strict=True))
