"""What limbs under glowing air have in common: against the laws written out, and against truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from limb_frames import as_frames, draw, limb_views
from limb_samples import nadir_nees
from scipy.stats import multivariate_normal

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.limb_rays import rays_of
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.air import usual_length_px
from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.glow.fit import fit_glow
from horizon_sensor_ros.core.limb.glow.limb import GlowLimb
from horizon_sensor_ros.core.limb.glow.one_sky import under_one_sky
from horizon_sensor_ros.core.limb.glow.points import points_alone, told_together
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.hard_scenes import hard_scenes

_ALTITUDE_M = 400e3
_NADIR, _RHO = np.array([0.0, 0.0, 1.0]), Planet().rho_from_altitude(_ALTITUDE_M)
_Seen = tuple[tuple[CameraView, ...], tuple[GlowLimb, ...]]


def _seen(seed: int, gains: tuple[float, float] = (1.0, 1.0)) -> _Seen:
    """Limbs of two frames, each fitted by itself."""
    imaging = tuple(Imaging(noise_dn=1.5, gain=gain) for gain in gains)
    views = limb_views(_ALTITUDE_M, azimuths_rad=(0.9 * seed, 0.9 * seed + 1.6))
    scene = EarthScene(texture="clouds", texture_seed=seed, air_dn=110.0, air_scale_height_m=8e3)
    frames = draw(views, _ALTITUDE_M, scene, imaging, seed)
    limbs = []
    for view, frame in zip(views, frames, strict=True):
        look = EdgeLook(0.75, usual_length_px(view, _RHO))
        limb = fit_glow(frame.image, view, _NADIR, _RHO, look)
        assert isinstance(limb, GlowLimb)
        limbs.append(limb)
    return views, tuple(limbs)


def _off_px(view: CameraView, px: np.ndarray, normal_px: np.ndarray) -> np.ndarray:
    points = LimbPoints(Status.OK, "", px, normal_px, np.ones(len(px)))
    return rays_of(view, points).residuals_px(_NADIR, _RHO)


def _slope_px(off_px: np.ndarray) -> float:
    return float(0.5 * np.polyfit(np.linspace(-0.5, 0.5, len(off_px)), off_px, 1)[0])


def _rise_px(views: tuple[CameraView, ...], limbs: tuple[GlowLimb, ...]) -> np.ndarray:
    """By how much each limb lies higher by what all frames tell."""
    change = under_one_sky(views, limbs).change
    return np.array([(limb.rows @ by).mean() for limb, by in zip(limbs, change, strict=True)])


def test_limbs_told_together_are_the_mean_over_laws_written_out() -> None:
    """Harmonics as so many unknowns, and what frames tell as measurements, in place of kernels and
    information; the limb is open to a radian.
    """
    views, limbs = _seen(2)
    seen, noise, polynomials = [], np.zeros((14, 14)), []
    for i, (view, limb) in enumerate(zip(views, limbs, strict=True)):
        known = np.linalg.inv(np.linalg.inv(limb.cov) - np.diag(limb.beforehand))
        usual = np.zeros(7)
        usual[3] = limb.air.edge_psf_px
        usual[6] = -0.5 * limb.air.log_glow[1] ** 2  # of the logarithm of an even change
        seen.append(known @ (np.linalg.solve(limb.cov, limb.value) - limb.beforehand * usual))
        noise[7 * i : 7 * i + 7, 7 * i : 7 * i + 7] = 2.5**2 * known
        base = view.camera.rays(limb.px) @ view.rot_base_from_cam.T
        angle = np.arctan2(base[:, 1], base[:, 0])
        waves = [wave(k * angle) for k in (1, 2, 3) for wave in (np.cos, np.sin)]
        places = np.vander(limb.along, 3, increasing=True)
        polynomials.append(np.linalg.lstsq(places, np.stack(waves, axis=1), rcond=None)[0])
    focus = np.mean([limb.air.edge_psf_px for limb in limbs])
    off = np.concatenate(seen)
    off[[3, 10]] -= focus
    off[[6, 13]] += [0.5 * limb.air.log_glow[1] ** 2 for limb in limbs]
    waves_to_log = np.concatenate(polynomials)
    share = np.repeat([0.75, 0.2, 0.05], 2)
    likely, means, covs = [], [], []
    for apart_px in (0.03, np.sqrt(2.0) * 0.1):
        for amplitude in 0.02 * 2.0 ** np.arange(7):
            law = np.diag([1.0] * 3 + [0.0] * 4 + [1.0] * 3 + [0.0] * 4)
            for i, j in np.ndindex(2, 2):
                law[7 * i + 3, 7 * j + 3] = 0.1**2 - 0.5 * apart_px**2 * (i != j)
                law[7 * i + 4, 7 * j + 4] = 25.0
            logs = [4, 5, 6, 11, 12, 13]
            law[np.ix_(logs, logs)] += amplitude**2 * (waves_to_log * share) @ waves_to_log.T
            gain = law @ np.linalg.inv(law + noise)
            means.append(gain @ off)
            covs.append(law - gain @ law)
            seen_so = multivariate_normal(np.zeros(14), law + noise).logpdf(off)
            likely.append(seen_so + 0.2 * np.log(amplitude))
    weight = np.exp(np.array(likely) - max(likely))
    weight /= weight.sum()
    mean = weight @ np.array(means)
    cov = np.einsum("h,hij->ij", weight, covs)
    cov += np.einsum("h,hi,hj->ij", weight, np.array(means) - mean, np.array(means) - mean)
    limb = [0, 1, 2, 7, 8, 9]
    found = under_one_sky(views, limbs)
    sigma = np.sqrt(np.diag(cov))[limb]
    assert np.abs(found.change.ravel() - mean[limb]).max() < 0.02 * sigma.max()
    alike = found.errors @ found.errors.T / np.outer(sigma, sigma)
    assert np.allclose(alike, cov[np.ix_(limb, limb)] / np.outer(sigma, sigma), atol=0.03)


def test_even_glow_is_known_to_be_even_and_turns_no_limb() -> None:
    before, after = [], []
    for seed in range(8):
        views, limbs = _seen(seed)
        told = told_together(
            [
                LimbObservation(view, points_alone(limb))
                for view, limb in zip(views, limbs, strict=True)
            ]
        )
        for view, limb, one in zip(views, limbs, told, strict=True):
            before.append(_slope_px(_off_px(view, limb.px, limb.normal_px)))
            after.append(_slope_px(_off_px(view, one.limb.px, one.limb.normal_px)))
    assert np.median(np.abs(after)) < 0.6 * np.median(np.abs(before))
    assert np.std(after) < 0.8 * np.std(before)


def test_the_lens_that_seems_to_blur_more_is_taken_to_lie_higher_than_its_frame_says() -> None:
    """A wider blur goes with a lower limb; lenses of one make blur alike, smeared frames do not."""
    apart_px, nearer_px = [], []
    for seed in range(5):
        views, limbs = _seen(seed)
        blurs = [limb.value[3] for limb in limbs]
        wider = int(np.argmax(blurs))

        smeared = tuple(replace(limb, smeared=True) for limb in limbs)
        apart_px.append(max(blurs) - min(blurs))
        rises_px = _rise_px(views, limbs) - _rise_px(views, smeared)
        nearer_px.append(rises_px[wider] - rises_px[1 - wider])
    assert min(nearer_px) > 0.0
    assert sum(nearer_px) > 0.15 * sum(apart_px)


def test_cameras_of_unlike_exposure_leave_open_whether_glow_is_even() -> None:
    claims = []
    for gains in ((1.0, 1.0), (1.0, 0.6)):
        errors = []
        for seed in range(3):
            views, limbs = _seen(seed, gains)
            found = under_one_sky(views, limbs)
            errors.append(np.linalg.norm(limbs[0].rows @ found.errors[:3], axis=1)[0])
        claims.append(np.mean(errors))
    assert claims[1] > 1.1 * claims[0]


def test_a_large_step_of_the_glow_from_frame_to_frame_claims_more() -> None:
    """Where glow is half as bright beside another camera's limb it is uneven along this one too,
    as no polynomial is: of 11 limbs of another renderer three were off by three sigma.
    """
    views, (limb, other) = _seen(0)
    claims_px = []
    for step in (0.0, 0.2, 1.0):
        dimmer = replace(other.air, log_glow=limb.air.log_glow - np.array([step, 0.0, 0.0]))
        seen = map(LimbObservation, views, map(points_alone, (limb, replace(other, air=dimmer))))
        claims_px.append(told_together(list(seen))[0].limb.shared.coherent_px)
    assert claims_px[1] == pytest.approx(claims_px[0])
    assert claims_px[2] > 1.2 * claims_px[0]


def test_lenses_that_blur_unlike_each_other_claim_what_they_are_off_by() -> None:
    nees = []
    for seed in range(8):
        views = limb_views(_ALTITUDE_M, azimuths_rad=(0.9 * seed, 0.9 * seed + 1.6))
        scene = EarthScene(texture="clouds", texture_seed=seed, air_dn=110.0)
        imaging = tuple(Imaging(noise_dn=1.5, psf_sigma_px=psf) for psf in (0.65, 1.0))
        fix = HorizonSensor().process(
            as_frames(views, draw(views, _ALTITUDE_M, scene, imaging, seed))
        )
        assert fix.ok, fix.reason
        nees.append(nadir_nees(fix.fit, _NADIR))
    assert np.mean(nees) < 3.0


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["air", "daylight", "low_sun"])
def test_two_cameras_claim_what_they_are_off_by_under_even_and_uneven_glow(kind: str) -> None:
    nees = []
    for scene in hard_scenes(16, 21, (kind,)):
        fix = HorizonSensor().process(as_frames(scene.views, scene.frames))
        if fix.ok:
            nees.append(nadir_nees(fix.fit, scene.frames[0].truth.nadir_base))
    # With the Sun below the horizon some show nothing.
    assert len(nees) >= (11 if kind == "low_sun" else 14)
    assert 0.3 < np.mean(nees) < 3.0
    assert sorted(nees)[-2] < 12.0


def test_one_frames_glow_in_doubt_of_the_lens_tells_no_less_than_nothing() -> None:
    views, limbs = _seen(1)
    doubtful = replace(limbs[0], cov=limbs[0].cov + np.diag([0, 0, 0, 0, 0, 0, 1.0]))
    found = under_one_sky(views, (doubtful, limbs[1]))
    assert np.isfinite(found.errors).all()
    informed = under_one_sky(views, limbs)
    wider, narrower = (np.trace(each.errors @ each.errors.T) for each in (found, informed))
    assert wider > narrower
    assert under_one_sky(views[:1], limbs[:1]).change.shape == (1, 3)
