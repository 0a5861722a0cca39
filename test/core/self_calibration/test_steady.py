"""Errors that stay the same all along a recording: no number of frame sets takes them out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration_sets import ROTATIONS, frame_sets, swinging

from horizon_sensor_ros.core.aiding import AltitudeMeasurement
from horizon_sensor_ros.core.mathematics.attitude import nadir_from_roll_pitch, tangent_basis
from horizon_sensor_ros.core.mathematics.rigid import rotation_from_vector, vector_from_rotation
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.self_calibration.adjustment import calibrate, sets_alike
from horizon_sensor_ros.core.self_calibration.measurement import FrameSet, NadirReference
from horizon_sensor_ros.core.self_calibration.result import Calibration, CalibrationConfig
from horizon_sensor_ros.core.status import Status

PLANET = Planet()


def rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def squared_error(found: Calibration, truth: np.ndarray, where: np.ndarray) -> float:
    off = found.values[where] - truth
    return float(off @ np.linalg.solve(found.cov[np.ix_(where, where)], off))


def test_an_altitude_that_is_off_all_along_moves_the_limb_by_as_much() -> None:
    squares = []
    for seed in range(24):
        sets = frame_sets(swinging(60), ROTATIONS, rng(seed), altitude_sigma_m=1e-3)
        known = AltitudeMeasurement(500e3 + 300.0 * rng(seed + 1000).standard_normal(), 300.0)
        found = calibrate([replace(each, altitude=known) for each in sets], ROTATIONS, PLANET)
        where = found.unknowns.where("limb_height")
        assert found.observed(int(where[0])) == "yes"
        assert found.sigmas[where[0]] > 300.0
        squares.append(squared_error(found, np.zeros(1), where))
    assert np.mean(squares) == pytest.approx(1.0, abs=0.5)


def test_errors_that_sets_close_in_time_share_are_counted_as_often_as_there_are_new_ones() -> None:
    """First-order autoregressive errors, whose correlation falls as the calibration takes it to."""
    time_s, sigma = 200.0, np.radians([0.03, 0.03, 0.02])
    squares = []
    for seed in range(24):
        random = rng(seed)
        kept = np.exp(-10.0 / time_s)  # from set to set
        errors = {camera: sigma * random.standard_normal(3) for camera in ROTATIONS}
        sets = []
        for each in frame_sets(swinging(80), ROTATIONS):
            seen = []
            for horizon in each.horizons:
                fresh = np.sqrt(1.0 - kept**2) * sigma * random.standard_normal(3)
                error = errors[horizon.camera] = kept * errors[horizon.camera] + fresh
                nadir = horizon.nadir_cam + tangent_basis(horizon.nadir_cam) @ error[:2]
                seen.append(
                    replace(
                        horizon,
                        nadir_cam=nadir / np.linalg.norm(nadir),
                        rho_rad=horizon.rho_rad + error[2],
                        cov_noise=1e-6 * np.diag(sigma**2),
                        cov_shared=np.diag(sigma**2),
                    )
                )
            sets.append(replace(each, horizons=tuple(seen)))
        config = CalibrationConfig(correlation_s=time_s, max_sigma=100.0)
        found = calibrate(sets, ROTATIONS, PLANET, config)
        where = found.unknowns.where("rotation", "camera_2")
        squares.append(squared_error(found, np.zeros(3), where))
    assert np.mean(squares) / 3 == pytest.approx(1.0, abs=0.4)


def test_a_reference_that_is_mounted_otherwise_turns_all_cameras() -> None:
    sigma = np.radians(0.05)
    squares = []
    for seed in range(24):
        turn = rotation_from_vector(sigma * rng(seed + 1000).standard_normal(3))
        sets = [
            replace(each, reference=NadirReference(turn @ nadir, sigma))
            for each, nadir in zip(
                frame_sets(swinging(60), ROTATIONS, rng(seed)), swinging(60), strict=True
            )
        ]
        found = calibrate(sets, ROTATIONS, PLANET)
        where = found.unknowns.where("rotation", "camera_1")
        squares.append(squared_error(found, np.zeros(3), where))
    assert np.mean(squares) / 3 == pytest.approx(1.0, abs=0.4)


@pytest.mark.parametrize(
    ("nadir", "sigma_rad", "named"),
    [
        ((0.0, 0.0, 2.0), 0.01, "nadir_base"),
        ((0.0, 0.0, np.nan), 0.01, "nadir_base"),
        ((0.0, 0.0, 1.0), 0.0, "sigma_rad"),
        ((0.0, 0.0, 1.0), np.nan, "sigma_rad"),
    ],
)
def test_a_reference_that_makes_no_sense_is_refused(
    nadir: tuple[float, float, float], sigma_rad: float, named: str
) -> None:
    with pytest.raises(ValueError, match=named):
        NadirReference(np.array(nadir), sigma_rad)


def test_how_many_sets_are_alike_is_a_sum_over_all_pairs() -> None:
    times = rng(0).uniform(0.0, 300.0, 200)
    pairs = np.exp(-np.abs(times[:, None] - times) / 60.0)
    assert sets_alike(times, 60.0) == pytest.approx(pairs.sum(axis=1).mean())
    assert sets_alike(times, 0.0) == 1.0
    # A day at 10 Hz, whose pairs would take terabytes: 60 s to either side of each.
    assert sets_alike(0.1 * np.arange(864_000), 60.0) == pytest.approx(1200.0, rel=1e-3)


def test_what_is_told_of_a_lens_stays() -> None:
    """Of both cameras' horizons nadir is off towards the axis, each by its own amount."""
    sigma = np.radians(0.03)
    squares = []
    for seed in range(24):
        amounts = sigma * rng(seed + 1000).standard_normal(2)
        found = calibrate(
            [_off(each, amounts, sigma) for each in frame_sets(swinging(60), ROTATIONS, rng(seed))],
            ROTATIONS,
            PLANET,
        )
        where = found.unknowns.where("rotation", "camera_2")
        assert all(found.observed(int(i)) == "yes" for i in where)
        squares.append(squared_error(found, np.zeros(3), where))
    # Where nadir lies to the axis changes as the craft swings, so that a part averages out.
    assert 0.3 < np.mean(squares) / 3 < 1.5


def _off(frames: FrameSet, amounts: np.ndarray, sigma: float) -> FrameSet:
    horizons = []
    for seen, amount in zip(frames.horizons, amounts, strict=True):
        nadir = seen.nadir_cam
        forward = np.array([0.0, 0.0, 1.0]) - nadir[2] * nadir
        forward /= np.linalg.norm(forward)
        horizons.append(
            replace(
                seen,
                nadir_cam=np.cos(amount) * nadir + np.sin(amount) * forward,
                cov_steady=np.diag([sigma**2, sigma**2, 1e-14]),
            )
        )
    return replace(frames, horizons=tuple(horizons))


def test_a_turn_about_a_nadir_beside_an_axis_is_no_turn_about_the_axes() -> None:
    """Nadir stays 7 deg off z; of a misalignment of 1 deg about z .12 deg would be told as about
    x, to half a thousandth of a degree.
    """
    nadir = nadir_from_roll_pitch(0.0, np.radians(7.0), "down")
    wrong = {**ROTATIONS, "camera_2": rotation_from_vector([0, 0, 0.0175]) @ ROTATIONS["camera_2"]}
    sets = frame_sets([nadir] * 60, wrong, rng(2))
    found = calibrate(sets, ROTATIONS, PLANET)
    x, y, z = (int(i) for i in found.unknowns.where("rotation", "camera_2"))
    assert np.degrees(found.values[x]) == pytest.approx(0.12, abs=0.02)
    assert [found.observed(i) for i in (x, y, z)] == ["partly", "yes", "no"]
    # Beside it by a degree, what may be hidden is in the sigma.
    nadir = nadir_from_roll_pitch(0.0, np.radians(1.0), "down")
    found = calibrate(frame_sets([nadir] * 60, ROTATIONS, rng(3)), ROTATIONS, PLANET)
    assert found.observed(x) == "yes"
    assert np.degrees(found.sigmas[x]) > np.sin(np.radians(1.0))


def test_what_is_less_sure_than_asked_for_stays_as_it_is() -> None:
    """Also where it is so for what the sets scatter beyond what their limbs claim."""
    sets = []
    noise = rng(8)
    for each in frame_sets(swinging(40, 2.0), ROTATIONS, rng(9)):
        turns = 0.002 * noise.standard_normal((2, 3))
        horizons = tuple(
            replace(h, nadir_cam=rotation_from_vector(turn) @ h.nadir_cam)
            for h, turn in zip(each.horizons, turns, strict=True)
        )
        sets.append(replace(each, horizons=horizons))
    config = CalibrationConfig(max_sigma=0.2)
    found = calibrate(sets, ROTATIONS, PLANET, config)
    assert found.ok, found.reason
    assert found.scatter > 1.5
    where = found.unknowns.where("rotation", "camera_2")
    seen = found.cov[np.ix_(where, where)]
    assert np.sqrt(np.linalg.eigvalsh(seen)[-1]) <= np.radians(0.2) * (1 + 1e-9)
    assert found.observed(int(where[2])) != "yes"
    turned = vector_from_rotation(found.rot_base_from_cam["camera_2"] @ ROTATIONS["camera_2"].T)
    assert abs(turned[2]) < np.radians(0.05)


def test_a_first_camera_that_sees_nothing_holds_nothing_still() -> None:
    third = {"camera_0": np.eye(3), **ROTATIONS}
    wrong = {**third, "camera_2": rotation_from_vector([0, 0.005, 0]) @ ROTATIONS["camera_2"]}
    truth = {name: wrong[name] for name in ROTATIONS}
    found = calibrate(frame_sets(swinging(60), truth, rng(4)), third, PLANET)
    where = found.unknowns.where("rotation", "camera_2")
    assert squared_error(found, np.array([0.0, 0.005, 0.0]), where) < 16.3
    np.testing.assert_array_equal(found.rot_base_from_cam["camera_1"], ROTATIONS["camera_1"])
    assert "camera_1 is taken as it is" in found.not_observed[0]
    assert any(sentence.startswith("camera_0") for sentence in found.not_observed)


@pytest.mark.parametrize(("count", "sigma_m"), [(60, 1200.0), (60, 2000.0)])
def test_an_altitude_that_is_not_sure_enough_turns_no_camera(count: int, sigma_m: float) -> None:
    """Limb height, 12 km off, is then left as it is; what it explains went into the rotations."""
    squares = []
    for seed in range(4):
        sets = frame_sets(swinging(count), ROTATIONS, rng(seed), planet=Planet(limb_height_m=12e3))
        known = AltitudeMeasurement(500e3, sigma_m)
        found = calibrate([replace(each, altitude=known) for each in sets], ROTATIONS, PLANET)
        where = found.unknowns.where("rotation", "camera_2")
        squares.append(squared_error(found, np.zeros(3), where))
        assert found.values[found.unknowns.where("limb_height")[0]] == 0.0
        assert "limb height: the altitude" in found.not_observed[-1]
    assert np.mean(squares) / 3 < 2.5


def test_a_reference_that_is_not_sure_enough_turns_no_camera_against_the_other() -> None:
    together = rotation_from_vector([0.0175, 0.0, 0.0])
    truth = {name: together @ rot for name, rot in ROTATIONS.items()}
    sigma = np.radians(0.15)
    sets = [
        replace(each, reference=NadirReference(nadir, sigma))
        for each, nadir in zip(frame_sets(swinging(60), truth, rng(3)), swinging(60), strict=True)
    ]
    found = calibrate(sets, ROTATIONS, PLANET)
    relative = found.rot_base_from_cam["camera_1"].T @ found.rot_base_from_cam["camera_2"]
    true = ROTATIONS["camera_1"].T @ ROTATIONS["camera_2"]
    off = np.linalg.norm(vector_from_rotation(relative @ true.T))
    assert off < 4.0 * np.max(found.sigmas[found.unknowns.where("rotation", "camera_2")])
    assert np.degrees(off) < 0.02
    assert found.not_observed[0].endswith("the reference is not sure enough")
    assert not any("camera_2 about" in sentence for sentence in found.not_observed)


def test_one_camera_whose_reference_is_not_sure_enough_is_not_calibrated() -> None:
    alone = {"camera_1": ROTATIONS["camera_1"]}
    sets = frame_sets(swinging(40), alone, rng(6), reference_sigma_rad=np.radians(0.3))
    found = calibrate(sets, alone, PLANET)
    assert found.status is Status.ILL_CONDITIONED
    assert "is not sure enough, and without it 0 of 40 frame sets" in found.reason


@pytest.mark.parametrize("sigma_m", [10.0, 2e3, 20e3])
def test_an_altitude_that_is_none_is_said(sigma_m: float) -> None:
    sets = frame_sets(swinging(30), ROTATIONS, rng(5))
    in_km = AltitudeMeasurement(500.0, sigma_m)
    found = calibrate([replace(each, altitude=in_km) for each in sets], ROTATIONS, PLANET)
    assert found.status is Status.ALTITUDE_OUT_OF_RANGE
    assert "metres" in found.reason
