"""Edges that no model fits, and air above them that other cameras show; edges that thin air may
have softened.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from horizon_fixes import NADIR, nees
from limb_frames import PLANET, as_frames, clouds, distance_px, draw, limb_views

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.covariance.lifted_edges import with_lifted_edges
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.air import usual_length_px
from horizon_sensor_ros.core.limb.refinement import refine_limb
from horizon_sensor_ros.core.limb.sample import RefinePass
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.earth_camera import SimFrame
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.poses import camera_from_fov

COARSE = camera_from_fov(320, 240, np.radians(70.0))
FINE = camera_from_fov(2048, 1536, np.radians(50.0))
ALTITUDE_M = 1.4e6
RHO_RAD = PLANET.rho_from_altitude(ALTITUDE_M)
VIEWS = limb_views(ALTITUDE_M, azimuths_rad=(0.4, 2.0))
NEAR = RefinePass(reach_px=3.0, grid_px=0.5, spacing_px=2.0)
FINAL = RefinePass(reach_px=1.0, grid_px=0.125, spacing_px=1.0)


@pytest.fixture(scope="module")
def limbs() -> tuple[LimbPoints, ...]:
    """Limbs of a planet without air, in focus: beside clouds they look a little softer."""
    fix = HorizonSensor().process(as_frames(VIEWS, draw(VIEWS, ALTITUDE_M, clouds(1))))
    assert fix.ok
    assert all(limb.modelled and len(limb.steepness) for limb in fix.limbs)
    return tuple(replace(limb, blur_px=0.75) for limb in fix.limbs)


def lifted(*limbs: LimbPoints) -> list[LimbPoints]:
    seen = [LimbObservation(view, limb) for view, limb in zip(VIEWS, limbs, strict=False)]
    return [one.limb for one in with_lifted_edges(seen, PLANET, RHO_RAD)]


def under_air(seed: int, air_dn: float) -> SimFrame:
    """A sharp lens' frame of clouds under thin air."""
    scene = replace(clouds(seed), air_dn=air_dn, air_scale_height_m=8e3)
    imaging = Imaging(noise_dn=1.5, psf_sigma_px=0.45)
    return draw(VIEWS[:1], ALTITUDE_M, scene, imaging, seed)[0]


def edges_of(frame: SimFrame) -> LimbPoints:
    _, looks = refine_limb(frame.image, VIEWS[0], NADIR, RHO_RAD, NEAR)
    return refine_limb(frame.image, VIEWS[0], NADIR, RHO_RAD, FINAL, looks)[0]


def test_edges_without_a_model_claim_more_beside_a_limb_that_glows(
    limbs: tuple[LimbPoints, ...],
) -> None:
    free = replace(limbs[0], modelled=False)
    glowing = replace(limbs[1], steepness=np.empty(0))
    separated = replace(limbs[1], cone_errors=np.zeros((4, 1)))
    length_px = usual_length_px(VIEWS[0], RHO_RAD)
    for other in (glowing, separated):
        one, same = lifted(free, other)
        assert same is other
        assert one.shared.shift_px > 0.7 * length_px
        assert one.shared.slope_px > limbs[0].shared.slope_px
        assert one.shared.height_px == limbs[0].shared.height_px
        np.testing.assert_array_equal(one.px, free.px)


def test_where_no_camera_shows_air_none_is_supposed(limbs: tuple[LimbPoints, ...]) -> None:
    free = replace(limbs[0], modelled=False)
    assert lifted(free, limbs[1])[0] is free
    assert lifted(limbs[0], replace(limbs[1], steepness=np.empty(0)))[0] is limbs[0]


def test_alone_or_beside_others_of_no_model_they_claim_as_much_as_beside_air(
    limbs: tuple[LimbPoints, ...],
) -> None:
    free = replace(limbs[0], modelled=False)
    beside_air = lifted(free, replace(limbs[1], steepness=np.empty(0)))[0].shared
    missed = LimbPoints.none(Status.NO_LIMB, "too faint")
    for alone in (lifted(free), lifted(free, missed), lifted(free, replace(free))):
        assert alone[0].shared == beside_air


def test_air_excuses_no_bend(limbs: tuple[LimbPoints, ...]) -> None:
    """By it edges are told that are no limb's."""
    free = replace(limbs[0], modelled=False)
    assert lifted(free)[0].shared.coherent_px == free.shared.coherent_px


def test_thin_air_above_edges_without_a_model_lifts_them_by_no_more_than_is_claimed() -> None:
    off_px = []
    for seed in range(8):
        frame = under_air(seed, air_dn=90.0)
        limb = edges_of(frame)
        if not limb.modelled:
            seen = (LimbObservation(VIEWS[0], limb), LimbObservation(VIEWS[0], glow_of(limb)))
            shared = with_lifted_edges(seen, PLANET, RHO_RAD)[0].limb.shared
            off_px.append(np.median(distance_px(frame.truth.limb, limb.px)))
            assert abs(off_px[-1]) < 2.0 * shared.shift_px
    assert len(off_px) >= 3
    assert np.mean(off_px) > 0.4  # and several times what they claim by themselves


def test_edges_that_air_may_have_softened_may_be_turned_by_it(
    limbs: tuple[LimbPoints, ...],
) -> None:
    """From afar air passes for blur; near the planet it is seen, and a soft lens is just soft."""
    soft, sharp = replace(limbs[0], blur_px=0.85), limbs[0]

    def claimed(limb: LimbPoints, altitude_m: float) -> LimbPoints:
        seen = (LimbObservation(VIEWS[0], limb),)
        return with_lifted_edges(seen, PLANET, PLANET.rho_from_altitude(altitude_m))[0].limb

    assert claimed(sharp, 4e6).shared.scale_px == sharp.shared.scale_px
    assert claimed(soft, 200e3) is soft
    assert claimed(soft, 4e6).shared.scale_px > 0.05
    # No more than air could: it fades over less and less of a pixel.
    assert claimed(soft, 36e6).shared.scale_px < 0.5 * claimed(soft, 4e6).shared.scale_px


@pytest.mark.parametrize("air_dn", [0.0, 60.0])
def test_a_wide_lens_far_above_thin_air_claims_how_it_turns_the_limb(air_dn: float) -> None:
    """Of limbs that others drew so one in five was beyond three sigma."""
    altitude_m, nees_of = 2.5e6, []
    camera = camera_from_fov(640, 480, np.radians(80.0))
    scene = replace(EarthScene(), air_dn=air_dn, air_scale_height_m=8e3)
    for seed in range(12):
        azimuths = (0.2 * seed,)
        views = limb_views(altitude_m, camera, azimuths, roll_rad=0.5 * seed, above_rad=0.25)
        drawn = draw(views, altitude_m, scene, Imaging(noise_dn=2.0), seed)
        nees_of.append(nees(HorizonSensor().process(as_frames(views, drawn)), NADIR))
    assert np.mean(nees_of) < 2.8
    assert max(nees_of) < (6.0 if air_dn else 11.8)


def claims(views: tuple[CameraView, ...], *limbs: LimbPoints) -> list[LimbPoints]:
    pairs = [LimbObservation(view, limb) for view, limb in zip(views, limbs, strict=True)]
    return [one.limb for one in with_lifted_edges(pairs, PLANET, PLANET.rho_from_altitude(1e6))]


def soft_limb(blur_px: float) -> LimbPoints:
    """One whose edges fit a model, without places."""
    return LimbPoints(
        Status.OK,
        px=np.zeros((9, 2)),
        steepness=np.ones(6),
        blur_px=blur_px,
        step=np.ones(9),
    )


def test_a_lens_as_sharp_as_any_hides_no_air() -> None:
    views = limb_views(1e6, COARSE)
    assert usual_length_px(views[0], PLANET.rho_from_altitude(1e6)) < 0.65
    (sharp,), (soft,) = claims(views, soft_limb(0.55)), claims(views, soft_limb(0.72))
    assert sharp.shared.dark_px == 0.0
    assert 0.05 < soft.shared.dark_px < 0.2


def test_fine_pixels_hide_no_air() -> None:
    sharp = soft_limb(0.72)
    assert claims(limb_views(1e6, FINE), sharp)[0] is sharp


def test_coarse_pixels_beside_fine_ones_may_have_their_limb_higher() -> None:
    """Eleven of 25 such pairs that others drew were beyond three sigma, by up to 16."""
    coarse, fine = limb_views(1e6, COARSE)[0], limb_views(1e6, FINE, (1.6,))[0]
    beside = claims((coarse, fine), soft_limb(0.72), soft_limb(0.75))
    alike = claims((coarse, coarse), soft_limb(0.72), soft_limb(0.72))
    assert beside[0].shared.shift_px > 0.08
    assert beside[1].shared.shift_px == 0.0
    assert alike[0].shared.shift_px == 0.0


def test_the_camera_whose_edges_are_softer_may_have_them_higher() -> None:
    views = limb_views(1e6, COARSE, (0.0, 1.6))
    for one in claims(views, soft_limb(0.70), soft_limb(0.80)):
        assert 0.02 < one.shared.shift_px < 0.1


def test_pixels_are_those_of_the_size_in_which_a_limb_shows() -> None:
    views = limb_views(1e6, COARSE)
    reduced = replace(soft_limb(2.0 * 0.72), factor=2)
    one = claims(views, reduced)[0]
    assert one.shared.dark_px == pytest.approx(
        2.0 * 0.4 * usual_length_px(views[0], PLANET.rho_from_altitude(1e6), 2), rel=0.2
    )


def glow_of(limb: LimbPoints) -> LimbPoints:
    return replace(limb, modelled=True, steepness=np.empty(0))
