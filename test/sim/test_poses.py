import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.poses import (
    camera_from_fov,
    pose_from_attitude,
    rot_from_axis,
    side_views,
)

ANGLE = st.floats(-1.5, 1.5)


def is_rotation(rot: np.ndarray) -> bool:
    return np.allclose(rot @ rot.T, np.eye(3), atol=1e-12) and np.linalg.det(rot) > 0


@given(ANGLE, ANGLE, st.floats(-3.1, 3.1), ANGLE, st.floats(-3.1, 3.1), st.booleans())
def test_attitude_gives_paper_c_nadir(
    roll: float, pitch: float, yaw: float, latitude: float, longitude: float, ellipsoid: bool
) -> None:
    planet = Planet.wgs84() if ellipsoid else Planet()
    rot, position = pose_from_attitude(
        500e3, roll, pitch, yaw, latitude_rad=latitude, longitude_rad=longitude, planet=planet
    )
    assert is_rotation(rot)
    nadir = [-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)]
    np.testing.assert_allclose(rot.T @ planet.nadir_ecef(position), nadir, atol=1e-9)
    assert planet.geodetic_from_ecef(position)[2] == pytest.approx(500e3, abs=1e-3)


def test_over_the_pole() -> None:
    rot, position = pose_from_attitude(500e3, 0.1, 0.2, latitude_rad=np.pi / 2)
    assert is_rotation(rot)
    assert position[2] == pytest.approx(6871e3)


def test_side_views_look_forward_and_right() -> None:
    camera = camera_from_fov(64, 48, 1.0)
    for axes, forward, right, down in (
        ("frd", [1, 0, 0], [0, 1, 0], [0, 0, 1]),
        ("flu", [1, 0, 0], [0, -1, 0], [0, 0, -1]),
    ):
        one, two = side_views(camera, axes)
        np.testing.assert_allclose(one.rot_base_from_cam[:, 2], forward, atol=1e-15)
        np.testing.assert_allclose(two.rot_base_from_cam[:, 2], right, atol=1e-15)
        for view in (one, two):
            np.testing.assert_allclose(view.rot_base_from_cam[:, 1], down, atol=1e-15)
    with pytest.raises(ValueError, match="base_axes"):
        side_views(camera, "enu")


def test_a_camera_has_the_field_of_view_asked_for() -> None:
    camera = camera_from_fov(400, 300, np.radians(60.0))
    edge = camera.rays(np.array([[-0.5, 149.5], [399.5, 149.5]]))
    assert np.degrees(np.arccos(edge[0] @ edge[1])) == pytest.approx(60.0)
    with pytest.raises(ValueError, match="fov_rad"):
        camera_from_fov(400, 300, 4.0)


@given(st.integers(0, 1000), st.floats(-7.0, 7.0))
def test_rot_from_axis(seed: int, roll: float) -> None:
    axis = np.random.default_rng(seed).standard_normal(3)
    rot = rot_from_axis(axis, roll)
    assert is_rotation(rot)
    np.testing.assert_allclose(rot[:, 2], axis / np.linalg.norm(axis), atol=1e-12)
    turned = rot_from_axis(axis, 0.0).T @ rot
    assert turned[0, 0] == pytest.approx(np.cos(roll))
