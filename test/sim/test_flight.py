from dataclasses import replace

import numpy as np
import pytest

from horizon_sensor_ros.core.mathematics.rigid import rotation_from_vector
from horizon_sensor_ros.sim.earth_scene import Imaging
from horizon_sensor_ros.sim.flight import Flight, swinging_flight

TIMES = np.linspace(0.0, 30.0, 16)


@pytest.mark.parametrize("axes", ["frd", "flu"])
def test_orbit_and_attitude(axes: str) -> None:
    flight = Flight(base_axes=axes)
    sign = np.array([1.0, 1.0, 1.0]) if axes == "frd" else np.array([1.0, -1.0, -1.0])
    for time in TIMES:
        rot, position = flight.pose(time)
        np.testing.assert_allclose(rot @ rot.T, np.eye(3), atol=1e-12)
        assert np.linalg.norm(position) == pytest.approx(6371e3 + 400e3)
        roll, pitch = flight.roll.at(time), flight.pitch.at(time)
        nadir = np.array(
            [-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)]
        )
        np.testing.assert_allclose(
            rot.T @ (-position / np.linalg.norm(position)), sign * nadir, atol=1e-12
        )


def test_orbit_has_its_period_and_inclination() -> None:
    flight = Flight()
    path = np.array([flight.pose(time)[1] for time in (0.0, 1.0)])
    # 7.67 km/s inertial, less about 0.3 km/s that the ground moves along with it
    assert 7.2e3 < np.linalg.norm(path[1] - path[0]) < 7.6e3
    highest = max(abs(flight.pose(time)[1][2]) for time in np.linspace(0, 5600, 400))
    assert np.arcsin(highest / 6771e3) == pytest.approx(np.radians(51.6), abs=1e-3)


def test_frames_depend_on_time_and_seed_only() -> None:
    flight = Flight()
    first = flight.frames(3.0)
    flight.frames(4.0)
    again = flight.frames(3.0)
    for a, b in zip(first, again, strict=True):
        assert np.array_equal(a.image, b.image)
        assert a.truth.limb.visible_length_px(12.0) > 400.0
    other = replace(flight, seed=1).frames(3.0)
    assert not np.array_equal(first[0].image, other[0].image)
    apart = first[0].image.astype(float) - other[0].image
    assert apart.std() < 4.0  # noise alone: the world is the same


def test_limb_stays_in_both_frames() -> None:
    flight = Flight()
    for time in TIMES[::3]:
        for frame in flight.frames(time):
            assert frame.truth.limb.visible_length_px(12.0) > 400.0


def test_a_swinging_craft_turns_up_to_its_rate() -> None:
    rate = np.radians(10.0)
    flight = swinging_flight(float(rate), np.random.default_rng(0))
    turns = np.array([flight.turn(time, 1e-3) for time in np.linspace(0.0, 40.0, 2000)])
    fastest = np.abs(turns).max(axis=0) / 1e-3
    # Of roll and pitch; yaw goes on by half a degree a second, the orbit by less.
    assert 0.8 * rate < fastest[:2].max() < 1.3 * rate
    (before, _), (after, _) = flight.pose(3.0), flight.pose(3.5)
    np.testing.assert_allclose(
        before @ rotation_from_vector(flight.turn(3.0, 0.5)), after, atol=1e-12
    )
    assert not flight.turn(3.0, 0.0).any()


def test_a_flights_rolling_shutter_shows_in_its_frames() -> None:
    flight = swinging_flight(float(np.radians(10.0)), np.random.default_rng(1))
    rolling = replace(flight, readout_s=0.02).frames(2.0)[0].image
    still = flight.frames(2.0)[0].image
    assert np.abs(rolling.astype(int) - still).max() > 50
    # The first rows are read at the stamp.
    assert np.abs(rolling[:2].astype(int) - still[:2]).mean() < 10.0


def test_a_flights_frames_are_exposed_about_their_time() -> None:
    flight = swinging_flight(float(np.radians(10.0)), np.random.default_rng(1))
    flight = replace(flight, imaging=Imaging(noise_dn=0.0))
    smeared = replace(flight, exposure_s=0.06).frames(2.0)[0]
    assert np.array_equal(smeared.truth.nadir_base, flight.frames(2.0)[0].truth.nadir_base)
    # As the mean of what is seen during that time.
    middles = 2.0 + 0.06 * ((np.arange(12) + 0.5) / 12.0 - 0.5)
    mean = np.mean([flight.frames(float(at))[0].image for at in middles], axis=0)
    still = flight.frames(2.0)[0].image
    # Rounding of gray levels is left.
    assert np.square(mean - smeared.image).mean() < 0.2
    assert np.square(mean - still).mean() > 0.4
