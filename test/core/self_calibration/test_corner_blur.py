"""Lenses that blur more in the corners, by all limbs of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from calibration_sets import ROTATIONS, frame_sets, swinging

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb_points import CornerBlur
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.self_calibration.corner_blur import LensBlur, lens_blurs
from horizon_sensor_ros.core.self_calibration.measurement import FrameSet, camera_horizon
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.flight import Flight, Swing

CAMERAS = tuple(ROTATIONS)
CORRELATION_S = 20.0
CAMERA = Camera(640, 480, 457.0, 457.0, 319.5, 239.5)


def sets_of(blurs: Sequence[CornerBlur | None], spacing_s: float = 20.0) -> list[FrameSet]:
    """Sets whose first camera's limbs show so much, and whose second one's show nothing."""
    sets = frame_sets(swinging(len(blurs)), ROTATIONS)
    return [
        FrameSet(spacing_s * i, (replace(each.horizons[0], corner_blur=blur), *each.horizons[1:]))
        for i, (each, blur) in enumerate(zip(sets, blurs, strict=True))
    ]


def scattered(truth_px: float, count: int, seed: int) -> list[CornerBlur | None]:
    seen = np.random.default_rng(seed).normal(truth_px, 0.1, count)
    return [CornerBlur(float(each), 0.06) for each in seen]


def first(sets: Sequence[FrameSet]) -> LensBlur:
    return lens_blurs(sets, CAMERAS, CORRELATION_S)[0]


def test_many_limbs_tell_a_lens_and_how_well() -> None:
    """By chance alone, of an even lens; by what all limbs show alike, of another."""
    off = []
    for seed in range(200):
        found = first(sets_of(scattered(0.0, 40, seed)))
        assert found.observed
        assert found.limbs == 40
        off.append(found.blur_px / found.sigma_px)
    assert np.mean(np.square(off)) == pytest.approx(1.0, abs=0.3)
    found = first(sets_of(scattered(0.3, 40, 1)))
    assert found.blur_px == pytest.approx(0.3, abs=2.0 * found.sigma_px)
    # However many limbs there are.
    assert first(sets_of(scattered(0.3, 400, 1))).sigma_px > 0.03


def test_limbs_beside_the_same_clouds_have_one_say() -> None:
    alike = [each for each in scattered(0.2, 20, 3) for _ in range(10)]
    found, once = first(sets_of(alike, 2.0)), first(sets_of(scattered(0.2, 20, 3)))
    assert found.limbs == once.limbs == 20
    assert found.blur_px == pytest.approx(once.blur_px)
    assert found.sigma_px == pytest.approx(once.sigma_px)


def test_rounded_stamps_do_not_put_sets_together() -> None:
    assert first(sets_of(scattered(0.2, 12, 3), 20.0 - 1e-9)).limbs == 12


def test_wrong_limbs_move_it_little() -> None:
    spoiled = scattered(0.2, 40, 5)
    spoiled[::8] = [CornerBlur(5.0, 0.01)] * 5
    found = first(sets_of(spoiled))
    assert found.blur_px == pytest.approx(0.2, abs=3.0 * found.sigma_px)
    assert found.sigma_px < 0.08


def test_what_is_not_seen_is_said() -> None:
    sets = sets_of([*scattered(0.2, 5, 1), *([None] * 30)])
    one, other = lens_blurs(sets, CAMERAS, CORRELATION_S)
    assert not one.observed
    assert (one.limbs, other.limbs) == (5, 0)
    assert "5 limbs beside different clouds show it, 8 are needed" in one.why_not
    assert np.isnan(one.blur_px)
    blurred = [CornerBlur(sign * 0.6, 0.1) for sign in (1.0, -1.0) * 6]
    unsure = first(sets_of(blurred))
    assert not unsure.observed
    assert "it comes out as" in unsure.why_not


def halfway_blur_px(imaging: Imaging) -> float:
    """Twice what a slanted edge shows halfway (by squares) out to the corner, one sigma by its
    steepest fall: the simulated lens is half the one there, and half the other.
    """
    pixel2 = 1.0 / 12.0
    middle, corner = (
        np.sqrt(psf**2 + pixel2) for psf in (imaging.psf_sigma_px, imaging.corner_psf_px)
    )
    return float(2.0 * (1.0 / (0.5 / middle + 0.5 / corner) - middle))


def flown(camera: Camera = CAMERA, **imaging: float) -> tuple[Flight, list[FrameSet]]:
    """A flight over clouds, and what fixes of each camera by itself show."""
    flight = Flight(
        altitude_m=500e3,
        roll=Swing(np.radians(12.0), np.radians(14.0), 90.0, 1.0),
        pitch=Swing(np.radians(-12.0), np.radians(15.0), 110.0, 2.0),
        camera=camera,
        scene=EarthScene(texture="clouds", texture_seed=11, cloud_contrast=0.3),
        imaging=Imaging(noise_dn=4.0, **imaging),
        seed=12,
    )
    sets = []
    for i in range(12):
        horizons = []
        for view, frame in zip(flight.views, flight.frames(20.0 * i), strict=True):
            fix = HorizonSensor().process([Frame(view, frame.image)])
            horizons.append(camera_horizon(view, fix, Planet()))
        sets.append(FrameSet(20.0 * i, tuple(each for each in horizons if each is not None)))
    return flight, sets


@pytest.mark.parametrize("corner_psf_px", [pytest.param(0.6, marks=pytest.mark.slow), 0.75, 1.0])
def test_frames_of_a_lens_tell_it(corner_psf_px: float) -> None:
    """By the simulator's truth, beside clouds."""
    flight, sets = flown(psf_sigma_px=0.6, corner_psf_px=corner_psf_px)
    for found in lens_blurs(sets, CAMERAS, CORRELATION_S):
        assert found.observed
        assert found.limbs >= 10
        off_px = found.blur_px - halfway_blur_px(flight.imaging)
        assert abs(off_px) < 3.0 * found.sigma_px


@pytest.mark.parametrize(
    ("camera", "psf_sigma_px"),
    [
        # As soft as those that three pixels of motion smear.
        (CAMERA, 1.0),
        # Air would glow over half a pixel above the limb.
        (Camera(320, 240, 130.0, 130.0, 159.5, 119.5), 0.6),
    ],
    ids=["soft", "coarse"],
)
def test_limbs_whose_blur_need_not_be_the_lens_s_tell_nothing(
    camera: Camera, psf_sigma_px: float
) -> None:
    _, sets = flown(camera, psf_sigma_px=psf_sigma_px)
    assert sum(len(each.horizons) for each in sets) > 12
    for found in lens_blurs(sets, CAMERAS, CORRELATION_S):
        assert not found.observed
        assert found.limbs == 0
