"""Streaks of the Sun, taken off frames that are drawn without them as well."""

from __future__ import annotations

import numpy as np
import pytest

from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.sun_streak import without_streaks
from horizon_sensor_ros.core.mathematics.attitude import angle_rad
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.flight import Flight, Swing

HEIGHT, WIDTH = 480, 640
SUN_PX = np.array([187.0, 146.0])  # x, y
RADIUS_PX = 18.0


def sky(level: float = 6.0) -> np.ndarray:
    return np.full((HEIGHT, WIDTH), level)


def sun_light(at_px: np.ndarray = SUN_PX) -> np.ndarray:
    """Disc that saturates, and its halo."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    far = np.hypot(x - at_px[0], y - at_px[1])
    return np.where(far < RADIUS_PX, 400.0, 150.0 / (1.0 + np.square(far / RADIUS_PX)))


def streak_light(at_px: np.ndarray = SUN_PX, peak: float = 90.0) -> np.ndarray:
    """Along the Sun's row: a bell of 2.5 px, that fades to a third of its height far away."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    along = 1.0 / 3.0 + 2.0 / 3.0 * np.exp(-np.abs(x - at_px[0]) / 150.0)
    return peak * along * np.exp(-0.5 * np.square((y - at_px[1]) / 2.5))


def taken(light: np.ndarray, seed: int = 0, bits: int = 8) -> np.ndarray:
    """What a camera with a noise of 1.5 gray levels of 8 bits makes of it."""
    noisy = light + np.random.default_rng(seed).normal(0.0, 1.5, light.shape)
    gain, kind = (1.0, np.uint8) if bits == 8 else (16.0, np.uint16)
    return np.clip(np.rint(gain * noisy), 0.0, 2**bits - 1).astype(kind)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("bits", [8, 12])
def test_a_streak_is_taken_off_and_nothing_else(turned: bool, bits: int) -> None:
    gain = 1.0 if bits == 8 else 16.0
    with_it = taken(sky() + sun_light() + streak_light(), bits=bits)
    without = taken(sky() + sun_light(), bits=bits)
    given = with_it.T.copy() if turned else with_it
    kept = given.copy()
    found = without_streaks(given)
    np.testing.assert_array_equal(given, kept)
    assert found.dtype == given.dtype
    found = found.T if turned else found
    off = (found.astype(float) - without) / gain
    beside_sun = np.abs(np.arange(WIDTH) - SUN_PX[0]) > 3.0 * RADIUS_PX
    row = round(SUN_PX[1])
    streak = off[row - 6 : row + 7, beside_sun]
    # Of some 60 gray levels.
    assert abs(streak.mean()) < 0.5
    assert np.abs(streak.mean(axis=1)).max() < 1.5
    far = np.abs(np.arange(HEIGHT) - row) > 15
    np.testing.assert_array_equal(found[far], with_it[far])
    saturated = with_it == 2**bits - 1
    np.testing.assert_array_equal(found[saturated], with_it[saturated])


def test_nothing_is_brighter_for_it() -> None:
    """Where something darker than its sides lies along the streak's row."""
    light = streak_light()
    light[:, 520:560] *= -0.2
    frame = taken(sky(12.0) + sun_light() + light)
    found = without_streaks(frame)
    assert found is not frame
    assert (found <= frame).all()


def test_a_sun_without_a_streak_is_left_alone() -> None:
    frame = taken(sky() + sun_light())
    assert without_streaks(frame) is frame


@pytest.mark.parametrize("seed", range(12))
def test_white_clouds_are_no_sun(seed: int) -> None:
    scene = EarthScene(texture="clouds", texture_seed=seed, cloud_dn=290.0, air_dn=80.0)
    for drawn in Flight(scene=scene, seed=seed).frames(0.0):
        assert (drawn.image == 255).mean() > 0.001
        assert without_streaks(drawn.image) is drawn.image


@pytest.mark.parametrize("value", [0, 255])
def test_frames_of_one_value_have_none(value: int) -> None:
    frame = np.full((48, 64), value, dtype=np.uint8)
    assert without_streaks(frame) is frame


@pytest.mark.parametrize("gap_px", [4, 13])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_streak_just_above_the_limb_does_not_move_it(gap_px: int, seed: int) -> None:
    """Along a limb under glowing air, four pixels above it, it moved nadir by .01 to .03 deg."""
    scene = EarthScene(texture="clouds", texture_seed=seed, cloud_contrast=0.5, air_dn=60.0)
    level, down = Swing(), Swing(np.radians(-14.0))
    imaging = Imaging(noise_dn=1.5)
    flight = Flight(scene=scene, imaging=imaging, seed=seed, roll=level, pitch=down)
    views, drawn = flight.views, flight.frames(0.0)
    first = drawn[0].image
    lit = (first > 60).any(axis=1)
    apex = int(np.argmax(lit))
    at_px = np.array([120.0, apex - gap_px])
    # Both are drawn on the same noise; the Sun itself is left out of the light beside the limb.
    light = streak_light(at_px, 140.0) + np.where(sun_light(at_px) > 255.0, 400.0, 0.0)
    spoilt = np.clip(np.rint(first + light), 0, 255).astype(np.uint8)
    fix = HorizonSensor().process([Frame(views[0], spoilt), Frame(views[1], drawn[1].image)])
    assert fix.ok
    error_deg = np.degrees(angle_rad(fix.fit.nadir_base, drawn[0].truth.nadir_base))
    assert error_deg < 0.008
