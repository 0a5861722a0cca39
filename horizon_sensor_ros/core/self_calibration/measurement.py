"""What self-calibration starts from: the horizon as each camera alone saw it, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from horizon_sensor_ros.core.aiding import AltitudeMeasurement
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.covariance.calibration_error import with_calibration_error
from horizon_sensor_ros.core.fits.maximum_likelihood import fit_maximum_likelihood
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.fix import HorizonFix
from horizon_sensor_ros.core.limb.air import usual_length_px
from horizon_sensor_ros.core.limb.edge.smear import STILL_PX
from horizon_sensor_ros.core.limb_points import CornerBlur, LimbPoints
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis, unit_direction
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.planet_figure import MeanSphere

_FOCAL_STEP = 1e-3
# Errors of a few hundredths of a pixel are the ground's texture, which changes as it passes; larger
# ones come of air that glows, much the same everywhere. Measured on simulated recordings.
_MOST_STEADY, _STEADY_FROM_PX = 0.5, 0.1
# Air that would glow over fewer pixels than this passes for blur.
_THIN_PX = 1.1


@dataclass(frozen=True, eq=False)
class CameraHorizon:
    """The horizon in one camera's frame, whatever its extrinsics.

    nadir_cam : (3,) unit, towards the planet's centre, optical frame. rho_rad : the disc's angular
    radius.
    cov_noise, cov_shared : (3, 3) covariance of nadir's two components along
    ``tangent_basis(nadir_cam)`` and of rho, rad^2: of the errors that are new in each frame, and of
    those that frames shortly after each other have in common (air, clouds at the limb).
    steady_share : share of one sigma of the shared errors that stays the same all along. cov_steady
    : of errors that do so whole: of the lens, as it is told, and of an ellipsoid of which nobody
    knows how it lies.
    focal_slope : (3,) derivative of the same three by the relative error of the focal length.
    corner_blur : as of `LimbPoints`, where nothing but the lens may have caused it.
    Raises ValueError where nadir or rho are not finite, or the covariance is none.
    """

    camera: str
    nadir_cam: np.ndarray
    rho_rad: float
    cov_noise: np.ndarray
    cov_shared: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    steady_share: float = 0.0
    cov_steady: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    focal_slope: np.ndarray = field(default_factory=lambda: np.zeros(3))
    corner_blur: CornerBlur | None = None

    def __post_init__(self) -> None:
        """Refuse what no fit gives."""
        if not (np.isfinite(self.nadir_cam).all() and np.isfinite(self.rho_rad)):
            got = f"{np.asarray(self.nadir_cam).tolist()} and {self.rho_rad}"
            raise ValueError(f"nadir_cam and rho_rad must be finite, got {got}")
        if not (np.linalg.eigvalsh(self.cov_noise + self.cov_shared) > 0.0).all():
            got = np.asarray(self.cov_noise).tolist()
            raise ValueError(f"cov_noise and cov_shared must be positive definite, got {got}")


@dataclass(frozen=True, eq=False)
class NadirReference:
    """Nadir (3,) in the base frame from another instrument, with its sigma in any direction: of an
    error that may be the same all along.

    Raises ValueError for a nadir that is no unit vector, or a sigma that is not positive.
    """

    nadir_base: np.ndarray
    sigma_rad: float

    def __post_init__(self) -> None:
        nadir = unit_direction(self.nadir_base, "nadir_base")
        if not np.allclose(nadir, self.nadir_base, atol=1e-6):
            raise ValueError(f"nadir_base must be a unit vector, got {self.nadir_base.tolist()}")
        if not (np.isfinite(self.sigma_rad) and self.sigma_rad > 0):
            raise ValueError(f"sigma_rad must be positive, got {self.sigma_rad}")


@dataclass(frozen=True, eq=False)
class FrameSet:
    """What is known of one moment: the cameras' horizons, altitude and attitude where given. The
    error of an altitude, too, may be the same all along.
    """

    time_s: float
    horizons: tuple[CameraHorizon, ...]
    altitude: AltitudeMeasurement | None = None
    reference: NadirReference | None = None

    @property
    def num_residuals(self) -> int:
        """Number of scalar measurements; nadir and altitude take three of them."""
        others = (self.altitude is not None) + 2 * (self.reference is not None)
        return 3 * len(self.horizons) + others


def camera_horizon(
    view: CameraView,
    fix: HorizonFix,
    sphere: Planet,
    *,
    focal: bool = False,
    lens_sigma_px: float = 0.0,
) -> CameraHorizon | None:
    """Horizon of one camera from a fix that was made of its frame alone; None without a fix.

    view : of that frame; sphere : the planet that was fitted. With `focal` the limb points are
    fitted twice more, for the derivative by the focal length. lens_sigma_px : as of
    `with_calibration_error`; the fix is one without it.
    """
    if not fix.ok or fix.airglow_alone:
        return None
    limb = fix.limbs[0]
    optical = CameraView(view.name, view.camera, np.eye(3))
    initial = (view.rot_base_from_cam.T @ fix.fit.nadir_base, fix.fit.rho_rad)
    seen = [LimbObservation(optical, limb)]
    alone = fit_maximum_likelihood(seen, sphere, initial)
    if not alone.ok:
        return None
    cov = _cov_nadir_rho(fix.fit, initial[0], view.rot_base_from_cam, sphere)
    noise = _cov_nadir_rho(alone, initial[0], np.eye(3), sphere)
    slope = _focal_slope(seen[0], sphere, initial) if focal else np.zeros(3)
    if slope is None:
        return None
    exact = replace(alone, cov_nadir_altitude=np.zeros((4, 4)))
    of_lens = with_calibration_error(exact, seen, sphere, lens_sigma_px=lens_sigma_px)
    steady_cov = _cov_nadir_rho(of_lens, initial[0], np.eye(3), sphere)
    figure = fix.fit.disc.figure if fix.fit.disc is not None else None
    if isinstance(figure, MeanSphere):
        # How the ellipsoid lies changes along the orbit, within many minutes.
        unknown = figure.covariance(alone, seen)
        of_figure = replace(alone, cov_nadir_altitude=unknown)
        of_figure_cov = _cov_nadir_rho(of_figure, initial[0], np.eye(3), sphere)
        steady_cov = steady_cov + of_figure_cov
        cov = cov - of_figure_cov
    shared = _positive_part(cov - noise)
    coherent_px = limb.shared.coherent_px
    steady = _MOST_STEADY * coherent_px / (coherent_px + _STEADY_FROM_PX)
    return CameraHorizon(
        view.name,
        initial[0],
        fix.fit.rho_rad,
        noise,
        shared,
        steady,
        steady_cov,
        slope,
        _corner_blur(view, limb, fix.fit.rho_rad, sphere),
    )


def _focal_slope(
    seen: LimbObservation, sphere: Planet, initial: tuple[np.ndarray, float]
) -> np.ndarray | None:
    """(3,) of nadir's two tangent components and rho, by a share of the focal length; None where a
    fit fails.

    initial : (nadir, rho) of the limb.
    """
    basis = tangent_basis(initial[0])
    slope = np.zeros(3)
    for sign in (1.0, -1.0):
        camera = seen.view.camera.with_focal_scale(1 + sign * _FOCAL_STEP)
        scaled = LimbObservation(replace(seen.view, camera=camera), seen.limb)
        moved = fit_maximum_likelihood([scaled], sphere, initial)
        if not moved.ok:
            return None
        change = np.append(moved.nadir_base @ basis, moved.rho_rad)
        slope += sign / (2.0 * _FOCAL_STEP) * change
    return slope


def _corner_blur(
    view: CameraView, limb: LimbPoints, rho_rad: float, sphere: Planet
) -> CornerBlur | None:
    """`CameraHorizon.corner_blur` of a limb with an angular radius: nothing where it is as soft as
    motion may make it (3 px do), or in air so thin that it is not told from blur.
    """
    smeared = not limb.blur_px < STILL_PX
    thin = sphere.has_air and usual_length_px(view, rho_rad) < _THIN_PX
    return None if smeared or thin else limb.corner_blur


def _cov_nadir_rho(
    fit: HorizonFit, nadir_cam: np.ndarray, rot_fit_from_cam: np.ndarray, sphere: Planet
) -> np.ndarray:
    """(3, 3) of the tangent components in the optical frame, and rho."""
    from_fit = np.zeros((3, 4))
    from_fit[:2, :3] = (rot_fit_from_cam @ tangent_basis(nadir_cam)).T
    from_fit[2, 3] = 1.0 / sphere.altitude_slope(fit.rho_rad)
    return from_fit @ fit.cov_nadir_altitude @ from_fit.T


def _positive_part(matrix: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return (vectors * np.maximum(values, 0.0)) @ vectors.T
