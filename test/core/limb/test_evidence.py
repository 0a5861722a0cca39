"""What a frame says about a limb that is right, and about limbs that are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from limb_frames import PLANET, clouds, draw, limb_views

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb.evidence import SkyEvidence, sky_evidence
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage
from horizon_sensor_ros.core.limb_curve import LimbCurve, limb_curve
from horizon_sensor_ros.sim.earth_camera import SimFrame
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging

NADIR = np.array([0.0, 0.0, 1.0])
ALTITUDE_M = 600e3
RHO = PLANET.rho_from_altitude(ALTITUDE_M)


def evidence(
    image: np.ndarray, view: CameraView, rho: float = RHO, nadir: np.ndarray = NADIR
) -> SkyEvidence:
    return sky_evidence(WorkingImage.of(image), view, nadir, rho)


def drawn(scene: EarthScene | None = None, **imaging: float) -> tuple[CameraView, SimFrame]:
    views = limb_views(ALTITUDE_M)
    how = Imaging(**{"noise_dn": 1.5, **imaging})  # type: ignore[arg-type]
    return views[0], draw(views, ALTITUDE_M, scene, how)[0]


@pytest.mark.parametrize("scene", [EarthScene(), clouds(1), clouds(2), clouds(3, 0.7)])
@pytest.mark.parametrize("factor", [1, 16, 257])
def test_the_true_limb_is_believed(scene: EarthScene, factor: int) -> None:
    view, frame = drawn(scene)
    image = frame.image if factor == 1 else frame.image.astype(np.uint16) * np.uint16(factor)
    told = evidence(image, view)
    assert told.bright_sky < 0.05
    assert told.lit_limb > 0.95
    assert told.clear_sky > 0.95
    assert told.contrast > 30
    assert told.dark_ground < 0.02
    length = np.linalg.norm(np.diff(frame.truth.limb.px, axis=0), axis=1).sum()
    assert told.limb_px == pytest.approx(length, rel=0.02)


def test_a_limb_drawn_through_the_planet_has_a_bright_sky() -> None:
    for scene in (EarthScene(), clouds(1), clouds(2)):
        view, frame = drawn(scene)
        told = evidence(frame.image, view, RHO - 0.15)
        assert told.bright_sky > 0.5
        assert told.clear_sky < 0.85


def test_ground_beyond_a_limb_that_bends_too_much_is_seen() -> None:
    """A cone that touches the true one in the frame's middle, as one through clouds may."""
    for scene in (EarthScene(), clouds(1), clouds(2)):
        view, frame = drawn(scene)
        assert evidence(frame.image, view).ground_beyond == 0.0
        towards_limb = np.array([1.0, 0.0, 0.0])
        told = []
        for turn_rad in (0.15, 0.25, 0.35):
            nadir = np.cos(turn_rad) * NADIR + np.sin(turn_rad) * towards_limb
            told.append(evidence(frame.image, view, RHO - turn_rad, nadir).ground_beyond)
        assert max(told) > 0.2, told


def test_neither_an_even_layer_nor_a_part_of_the_craft_is_ground_beyond() -> None:
    view, frame = drawn()
    limb, layered, hidden = frame.truth.limb, frame.image.copy(), frame.image.copy()
    for distance_px in np.arange(14.0, 24.0, 0.5):
        x, y = np.rint(limb.px + distance_px * limb.normal_px).astype(np.intp).T
        inside = (x >= 0) & (x < layered.shape[1]) & (y >= 0) & (y < layered.shape[0])
        layered[y[inside], x[inside]] = 150
    assert evidence(layered, view).ground_beyond == 0.0
    hidden[:, 250:450] = 180
    assert evidence(hidden, view).ground_beyond == 0.0


def test_a_limb_drawn_before_it_was_fitted_will_do_where_it_lies_near() -> None:
    view, frame = drawn(clouds(1))
    working = WorkingImage.of(frame.image)

    def told(predicted: LimbCurve | None) -> SkyEvidence:
        return sky_evidence(working, view, NADIR, RHO, predicted)

    near, far = (limb_curve(view, NADIR, RHO + off) for off in (0.0005, -0.15))
    anew = told(None)
    assert told(far) == anew
    as_predicted = told(near)
    assert as_predicted.limb_px == pytest.approx(anew.limb_px, rel=0.02)
    for name in ("bright_sky", "lit_limb", "clear_sky", "dark_ground"):
        assert getattr(as_predicted, name) == pytest.approx(getattr(anew, name), abs=0.03)
    assert as_predicted.contrast == pytest.approx(anew.contrast, rel=0.05)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_between_the_lights_of_the_night_side_the_ground_is_dark(seed: int) -> None:
    night = replace(
        clouds(seed), sun_direction=(-0.6, -0.64, -0.48), night_light=0.0, city_dn=300.0
    )
    view, frame = drawn(night)
    told = evidence(frame.image, view)
    assert told.lit_limb > 0.3
    assert told.dark_ground > 0.3


def test_a_limb_drawn_through_space_is_dark_on_both_sides() -> None:
    view, frame = drawn(clouds(1))
    told = evidence(frame.image, view, RHO + 0.1)
    assert told.lit_limb < 0.05
    assert told.bright_sky < 0.05
    assert told.contrast < 6


def test_half_of_the_limb_by_night() -> None:
    """The dark half counts neither for nor against: sky is dark there, limb unlit."""
    view, frame = drawn()
    image = frame.image.copy()
    image[:, :320] = 4
    told = evidence(image, view)
    limb = frame.truth.limb.px
    assert told.lit_limb == pytest.approx(np.mean(limb[:, 0] >= 320), abs=0.05)
    assert told.bright_sky < 0.05
    assert told.clear_sky > 0.95


def test_a_flooded_sky_is_seen() -> None:
    view, frame = drawn()
    y, x = np.mgrid[:480, :640]
    outside = frame.image < 100
    away = (x - x[outside].mean()) ** 2 + (y - y[outside].mean()) ** 2
    flood = np.where(outside, 60 + 100 * np.exp(-away / 3e4), frame.image)
    told = evidence(flood.astype(np.uint8), view)
    assert told.clear_sky < 0.72 or told.bright_sky > 0.25


def test_contrast_is_in_sigmas_of_the_reduced_image() -> None:
    view, faint = drawn(EarthScene(uniform_dn=30.0), noise_dn=4.0)
    told = evidence(faint.image, view)
    # averaged over 2 x 2 pixels: 30 DN over 4 / 2
    assert told.contrast == pytest.approx(15.0, rel=0.45)


def test_no_limb_in_the_frame_says_nothing() -> None:
    away = limb_views(ALTITUDE_M, above_rad=1.0)[0]
    told = evidence(np.full((480, 640), 4, np.uint8), away)
    assert told.limb_px == 0.0
    assert np.isnan(told.clear_sky)


def test_hardly_any_sky_is_no_evidence_about_it() -> None:
    """The limb in one corner of the frame: too little sky to judge by."""
    view = limb_views(ALTITUDE_M, above_rad=-0.46)[0]
    frame = draw((view,), ALTITUDE_M)[0]
    told = evidence(frame.image, view)
    assert 0 <= told.limb_px < 320
    assert np.isnan(told.clear_sky) or told.clear_sky > 0.9


def with_glare(radius_px: float, fade_px: float) -> SkyEvidence:
    """Evidence beside a limb, a bright disc in the sky and light fading from it."""
    view, frame = drawn(EarthScene(uniform_dn=90.0))
    y, x = np.mgrid[: frame.image.shape[0], : frame.image.shape[1]]
    rays = view.camera.rays(np.stack([x.ravel(), y.ravel()], axis=1).astype(float))
    sky = np.flatnonzero(rays @ (view.rot_base_from_cam.T @ NADIR) < np.cos(RHO + 0.15))
    spot = sky[len(sky) // 2]
    distance = np.hypot(x - spot % frame.image.shape[1], y - spot // frame.image.shape[1])
    light = np.where(distance < radius_px, 255.0, 200.0 * np.exp(-(distance - radius_px) / fade_px))
    return evidence(np.clip(frame.image + light, 0, 255).astype(np.uint8), view)


def test_the_suns_glare_is_no_cloud_in_the_sky() -> None:
    told = with_glare(30.0, 60.0)
    assert told.clear_sky > 0.8
    assert told.bright_sky < 0.1


@pytest.mark.parametrize("angle_rad", [0.0, 1.0, 2.5])
def test_a_little_stray_light_is_no_cloud_in_the_sky(angle_rad: float) -> None:
    view, frame = drawn(EarthScene(uniform_dn=150.0), stray_dn=40.0, stray_angle_rad=angle_rad)
    told = evidence(frame.image, view)
    assert told.clear_sky > 0.9
    assert told.bright_sky < 0.1


def with_light_from_one_side(brightest_dn: float, power: float) -> SkyEvidence:
    """Evidence where light rises from one side of the frame to the other, evenly with power 1."""
    view, frame = drawn(EarthScene(uniform_dn=90.0))
    ramp = brightest_dn * np.linspace(0.0, 1.0, frame.image.shape[1]) ** power
    return evidence(np.clip(frame.image + ramp, 0, 255).astype(np.uint8), view)


def test_light_that_no_sun_explains_counts_against_the_sky() -> None:
    assert with_light_from_one_side(80.0, 2.0).clear_sky < 0.72
    assert with_light_from_one_side(160.0, 1.0).clear_sky < 0.72


def test_light_that_rises_evenly_to_half_of_the_limbs_is_none_against_the_sky() -> None:
    assert with_light_from_one_side(80.0, 1.0).clear_sky > 0.95
