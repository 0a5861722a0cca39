"""A camera that turns while it exposes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import rotation_from_vector
from horizon_sensor_ros.sim.earth_camera import render
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.exposure import attitudes_during
from horizon_sensor_ros.sim.poses import camera_from_fov, rot_from_axis

CAMERA = camera_from_fov(200, 200, np.radians(60.0))
ROT = rot_from_axis(np.array([0.6, 0.0, 0.8]), 0.4)


def at_the_limb(roll_rad: float) -> tuple[np.ndarray, np.ndarray]:
    """Attitude and position of a camera that looks at the limb from 1000 km up."""
    radius = EarthScene().planet.radius_m
    rho = np.arcsin(radius / (radius + 1000e3))
    rot = rot_from_axis(np.array([np.cos(rho), np.sin(rho), 0.0]), roll_rad)
    return rot, np.array([-(radius + 1000e3), 0.0, 0.0])


def test_attitudes_are_spread_evenly_about_the_middle() -> None:
    turn = np.array([0.02, -0.05, 0.03])
    attitudes = attitudes_during(ROT, turn, CAMERA)
    pixel_rad = 1.0 / CAMERA.fx
    assert len(attitudes) > np.linalg.norm(turn) / pixel_rad
    step = rotation_from_vector(turn / len(attitudes))
    for before, after in pairwise(attitudes):
        np.testing.assert_allclose(before @ step, after, atol=1e-12)
    # As far behind the pose at the beginning as ahead of it at the end.
    np.testing.assert_allclose(ROT.T @ attitudes[0], (ROT.T @ attitudes[-1]).T, atol=1e-12)


def test_one_attitude_at_rest() -> None:
    (only,) = attitudes_during(ROT, np.zeros(3), CAMERA)
    np.testing.assert_array_equal(only, ROT)


def test_a_smeared_edge_is_a_ramp_as_long_as_the_motion() -> None:
    """A box as wide as the motion, blurred by pixel and optics, to a first approximation."""
    rot, position = at_the_limb(0.0)
    imaging = Imaging(noise_dn=0.0, bits=8)
    limb = render(CAMERA, rot, position, EarthScene(), np.random.default_rng(0)).truth.limb
    middle = np.argmin(np.linalg.norm(limb.px - 99.5, axis=1))
    normal = limb.normal_px[middle]
    turn = 12.0 / CAMERA.fx * np.array([-normal[1], normal[0], 0.0])
    smeared = render(
        CAMERA, rot, position, EarthScene(), np.random.default_rng(0), imaging=imaging,
        turn_base_rad=turn,
    )  # fmt: skip
    image = smeared.image.astype(float)
    y, x = np.mgrid[:200, :200]
    out = (x - limb.px[middle, 0]) * normal[0] + (y - limb.px[middle, 1]) * normal[1]
    along = -(x - limb.px[middle, 0]) * normal[1] + (y - limb.px[middle, 1]) * normal[0]
    near = (np.abs(along) < 5.0) & (np.abs(out) < 4.0)
    fitted = np.polyfit(out[near], image[near], 1)
    step = image[(np.abs(along) < 5.0) & (out < -10.0) & (out > -15.0)].mean() - 4.0
    np.testing.assert_allclose(-step / fitted[0], 12.0, rtol=0.05)
    np.testing.assert_allclose(fitted[1] - 4.0, 0.5 * step, rtol=0.04)


def test_a_row_shows_what_a_still_camera_sees_when_it_is_read() -> None:
    rot, position = at_the_limb(0.4)
    turn = np.radians([2.0, -1.5, 3.0])
    still = Imaging(noise_dn=0.0, psf_sigma_px=0.0)

    def drawn(at: np.ndarray, reading: np.ndarray | None = None) -> np.ndarray:
        frame = render(
            CAMERA, at, position, EarthScene(), np.random.default_rng(0), imaging=still,
            readout_turn_base_rad=reading,
        )  # fmt: skip
        return frame.image.astype(float)

    rolling = drawn(rot, turn)
    for row in (1, 61, 121, 198):
        want = drawn(rot @ rotation_from_vector(row / 199.0 * turn))[row]
        # Four rows are drawn at once; of a pixel that the limb crosses the share may differ.
        assert np.abs(rolling[row] - want).sum() < 0.15 * want.max()
    assert np.abs(rolling - drawn(rot)).max() > 50.0
