"""The field of applicability against closed forms, a brute-force count, and paper A's figure 6."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from horizon_sensor_ros.core.applicability.section_circle import (
    section_circle,
    section_circle_in_frame,
)
from horizon_sensor_ros.core.applicability.visibility import (
    cone_rays,
    horizon_in_view,
    horizon_rays,
    limb_in_view,
    rot_base_from_down,
)
from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

PLANET = Planet()
RHO = PLANET.rho_from_altitude(300e3)
ALPHA = np.radians(28.0)
FOCAL = 400 / np.tan(ALPHA)
CAMERA = Camera(640, 480, FOCAL, FOCAL, 319.5, 239.5)
UPRIGHT = (-1.0, 0.0, 0.0)
# Looking along y and z, the planet towards -x at the bottom of the frame.
VIEW_1 = CameraView("camera_1", CAMERA, np.column_stack([(0, 0, -1), UPRIGHT, (0, 1, 0)]))
VIEW_2 = CameraView("camera_2", CAMERA, np.column_stack([(0, 1, 0), UPRIGHT, (0, 0, 1)]))
DISTORTED = Camera(640, 480, 600.0, 610.0, 325.0, 236.0, "plumb_bob", (-0.2, 0.05, 1e-3, -5e-4, 0))
FISHEYE = Camera(640, 480, 190.0, 190.0, 319.5, 239.5, "equidistant", (0.01, -0.002, 0, 0))

angle = st.floats(-np.pi, np.pi)


def paper_map(step_deg: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Yaw and pitch (deg, flat) of paper A's map, and the attitudes."""
    degrees = np.arange(-90.0, 90.0 + step_deg / 2, step_deg)
    yaw, pitch = (grid.ravel() for grid in np.meshgrid(degrees, degrees))
    return yaw, pitch, rot_base_from_down(0.0, np.radians(pitch), np.radians(yaw), UPRIGHT)


def test_level_craft_has_the_contract_nadir_and_no_yaw():
    roll, pitch, yaw = 0.3, -0.2, 1.1
    attitude = rot_base_from_down(roll, pitch, yaw)[0]
    # Minus the third row of Ry(pitch) Rx(roll): the level frame's z axis is up.
    expected = -np.array(
        [-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)]
    )
    np.testing.assert_allclose(attitude[:, 2], expected, atol=1e-15)


@given(angle, angle, angle)
def test_attitudes_are_rotations(roll, pitch, yaw):
    for nadir in ((0.0, 0.0, -1.0), UPRIGHT, (0.0, 0.6, 0.8)):
        rot = rot_base_from_down(roll, pitch, yaw, nadir)[0]
        np.testing.assert_allclose(rot @ rot.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rot) > 0
        zero = rot_base_from_down(0.0, 0.0, 0.0, nadir)[0]
        np.testing.assert_allclose(zero[:, 2], nadir, atol=1e-12)


@pytest.mark.parametrize("camera", [CAMERA, DISTORTED, FISHEYE], ids=["plain", "lens", "fisheye"])
@settings(max_examples=25)
@given(roll=angle, pitch=angle, yaw=angle, altitude_km=st.floats(250, 6000))
def test_agrees_with_a_dense_count(camera, roll, pitch, yaw, altitude_km):
    """Independent: project very many rays one by one and count those in the frame."""
    rho = PLANET.rho_from_altitude(1e3 * altitude_km)
    view = CameraView("camera", camera, VIEW_2.rot_base_from_cam)
    attitude = rot_base_from_down(roll, pitch, yaw)
    got = horizon_in_view(view, cone_rays(rho), attitude)
    dense = cone_rays(rho, 72000)
    px = camera.pixels(dense @ (view.rot_base_from_cam.T @ attitude[0]).T)
    inside = camera.in_frame(px)
    # An end of an arc is off by a dense sample at most; an arc below a coarse one is lost.
    assert got.fraction[0] == pytest.approx(inside.mean(), abs=4 / 720)
    steps = np.hypot(*(np.roll(px, -1, axis=0) - px).T)[inside & np.roll(inside, -1)]
    runs = int(np.sum(inside & ~np.roll(inside, 1))) or int(inside.all())
    if runs == got.num_arcs[0]:
        assert got.fraction[0] == pytest.approx(inside.mean(), abs=4e-5 * max(runs, 1))
        assert got.arc_px[0] == pytest.approx(steps.sum(), abs=0.3 * max(runs, 1), rel=2e-5)
    assert got.longest_px[0] <= got.arc_px[0] + 1e-9
    assert got.visible[0] == (got.num_arcs[0] > 0)


def test_whole_horizon_in_the_frame():
    """Straight down from far away the limb is a circle round the principal point."""
    rho = PLANET.rho_from_altitude(30e6)
    down = CameraView("down", CAMERA, np.eye(3))
    vis = horizon_in_view(down, cone_rays(rho), rot_base_from_down(0.0, 0.0, 0.0, (0, 0, 1.0)))
    assert vis.num_arcs[0] == 1
    assert vis.fraction[0] == 1.0
    circle = 2 * np.pi * FOCAL * np.tan(rho)
    assert vis.arc_px[0] == pytest.approx(circle, rel=1e-5)
    assert vis.longest_px[0] == pytest.approx(circle, rel=1e-5)


def test_four_arcs_when_the_limb_is_wider_than_the_frame_but_not_its_diagonal():
    rho = np.arctan(
        360.0 / FOCAL
    )  # a circle of 360 px in a square frame of half-width 300, diagonal 424
    camera = Camera(600, 600, FOCAL, FOCAL, 299.5, 299.5)
    down = CameraView("down", camera, np.eye(3))
    vis = horizon_in_view(down, cone_rays(rho), rot_base_from_down(0.0, 0.0, 0.0, (0, 0, 1.0)))
    assert vis.num_arcs[0] == 4
    # In each corner between acos(300/360) off either side's axis.
    arc = np.pi / 2 - 2 * np.arccos(300 / 360)
    assert vis.fraction[0] == pytest.approx(4 * arc / (2 * np.pi), abs=2e-6)
    assert vis.arc_px[0] == pytest.approx(4 * 360 * arc, rel=2e-5)
    assert vis.longest_px[0] == pytest.approx(360 * arc, rel=2e-5)


@given(turn=st.floats(-np.pi, np.pi))
@settings(max_examples=30)
def test_azimuth_zero_is_nowhere_special(turn):
    """Turning the down frame about nadir moves the samples' origin, also into an arc."""
    attitude = rot_base_from_down(0.0, 0.4, 0.3, UPRIGHT)
    cos, sin = np.cos(turn), np.sin(turn)
    about_nadir = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])
    here = horizon_in_view(VIEW_1, cone_rays(RHO), attitude)
    there = horizon_in_view(VIEW_1, cone_rays(RHO), attitude @ about_nadir)
    for name in ("fraction", "arc_px", "longest_px"):
        assert getattr(there, name)[0] == pytest.approx(getattr(here, name)[0], rel=2e-4)
    assert there.num_arcs[0] == here.num_arcs[0] == 1


def test_figure_6_has_two_maxima_where_the_horizon_runs_along_the_diagonals():
    """Paper A: half-aperture 28 deg, 300 km, 3:4.

    In closed form: opposite corners are alpha off the axis and rho off nadir, so the axis is turned
    by the diagonal's angle and asin(cos rho / cos alpha) below level; nothing longer fits.
    """
    yaw_best = np.degrees(np.arcsin(np.cos(RHO) / np.cos(ALPHA)))
    pitch_best = np.degrees(np.arctan2(3, 4))
    most = np.arcsin(np.sin(ALPHA) / np.sin(RHO)) / np.pi
    yaw, pitch, attitudes = paper_map(1.0)
    vis = horizon_in_view(VIEW_1, cone_rays(RHO), attitudes)
    assert 0.25 < vis.visible.mean() < 0.31
    assert vis.fraction.max() <= most
    for sign in (1, -1):
        half = np.sign(pitch) == sign
        for measure in (vis.fraction, vis.arc_px):
            at = np.flatnonzero(half)[np.argmax(measure[half])]
            assert yaw[at] == pytest.approx(yaw_best, abs=1.0)
            assert pitch[at] == pytest.approx(sign * pitch_best, abs=1.0)
    # A maximum, not a ridge: between the two the horizon is shorter.
    level = (pitch == 0) & (np.abs(yaw - 20) < 0.5)
    assert vis.arc_px[level][0] < 0.85 * vis.arc_px.max()

    exactly = rot_base_from_down(0.0, np.radians(pitch_best), np.radians(yaw_best), UPRIGHT)
    top = horizon_in_view(VIEW_1, cone_rays(RHO), exactly)
    assert top.fraction[0] == pytest.approx(most, abs=1e-5)
    assert top.arc_px[0] >= vis.arc_px.max()
    px = limb_in_view(VIEW_1, cone_rays(RHO, 7200), exactly[0]).px
    ends = px[[np.argmin(px[:, 0]), np.argmax(px[:, 0])]]
    np.testing.assert_allclose(ends, [[-0.5, 479.5], [639.5, -0.5]], atol=1.5)


def test_second_camera_sees_the_first_ones_map_turned_by_90_degrees_near_the_origin():
    """Clockwise about the origin, as the paper says: (yaw, pitch) of the first at (pitch, -yaw)."""
    small = np.radians(np.linspace(-4, 4, 9))
    yaw, pitch = (grid.ravel() for grid in np.meshgrid(small, small))
    rays = cone_rays(RHO)
    first = horizon_in_view(VIEW_1, rays, rot_base_from_down(0.0, pitch, yaw, UPRIGHT))
    second = horizon_in_view(VIEW_2, rays, rot_base_from_down(0.0, -yaw, pitch, UPRIGHT))
    inner = first.arc_px > 0
    assert np.mean(inner == (second.arc_px > 0)) > 0.95
    np.testing.assert_allclose(second.fraction, first.fraction, atol=0.02)


def test_both_cameras_see_the_horizon_only_in_the_intersection():
    _, _, attitudes = paper_map(3.0)
    rays = cone_rays(RHO)
    first, second = (horizon_in_view(view, rays, attitudes).visible for view in (VIEW_1, VIEW_2))
    assert 0.05 < np.mean(first & second) < 0.11


def test_flattening_zero_of_the_ellipsoid_is_the_sphere_and_wgs84_is_near_it():
    sphere = horizon_rays(PLANET, 500e3, 360)
    almost = horizon_rays(Planet(PLANET.radius_m, 0.0, 1e-12), 500e3, 360, 0.7, 0.4)
    np.testing.assert_allclose(almost, sphere, atol=1e-6)
    wgs84 = horizon_rays(Planet.wgs84(), 500e3, 360, 0.7, 0.4)
    off = np.degrees(np.arccos(np.sum(wgs84 * sphere, axis=1)))
    assert 0.02 < off.max() < 0.5


def test_heading_turns_the_ellipsoids_horizon():
    wgs84 = Planet.wgs84()
    north = horizon_rays(wgs84, 500e3, 360, 0.7, 0.0)
    east = horizon_rays(wgs84, 500e3, 360, 0.7, np.pi / 2)
    # The ray ahead of a craft that heads east is the one at azimuth 90 deg of one that heads north.
    np.testing.assert_allclose(east[:, 2], np.roll(north[:, 2], -90), atol=1e-12)


@pytest.mark.parametrize("camera", [CAMERA, DISTORTED, FISHEYE], ids=["plain", "lens", "fisheye"])
def test_limb_points_lie_on_the_horizon_with_normals_towards_space(camera):
    view = CameraView("camera", camera, VIEW_1.rot_base_from_cam)
    attitude = rot_base_from_down(0.0, 0.5, 0.3, UPRIGHT)[0]
    limb = limb_in_view(view, cone_rays(RHO, 7200), attitude, sigma_px=0.2)
    assert limb.status is Status.OK
    assert camera.in_frame(limb.px).all()
    nadir_cam = view.rot_base_from_cam.T @ attitude[:, 2]
    np.testing.assert_allclose(camera.rays(limb.px) @ nadir_cam, np.cos(RHO), atol=1e-9)
    step = 1e-3
    outside = camera.rays(limb.px + step * limb.normal_px) @ nadir_cam
    along = np.column_stack([-limb.normal_px[:, 1], limb.normal_px[:, 0]])
    aside = camera.rays(limb.px + step * along) @ nadir_cam
    assert (outside < np.cos(RHO)).all()
    # Steepest across the limb, flat along it.
    assert np.abs(aside - np.cos(RHO)).max() < 1e-3 * np.abs(outside - np.cos(RHO)).min()
    spacing = np.hypot(*np.diff(limb.px, axis=0).T)
    assert 0.5 < np.median(spacing) < 1.6
    np.testing.assert_array_equal(limb.sigma_px, 0.2)


def test_limb_out_of_the_frame_is_a_status():
    limb = limb_in_view(VIEW_1, cone_rays(RHO), rot_base_from_down(0.0, 0.0, -1.0, UPRIGHT)[0])
    assert limb.status is Status.NO_LIMB
    assert len(limb.px) == 0
    assert "outside the frame" in limb.reason


def test_wrong_arguments_name_themselves():
    with pytest.raises(ValueError, match="rho_rad"):
        cone_rays(2.0)
    with pytest.raises(ValueError, match="samples"):
        cone_rays(1.0, 3)
    with pytest.raises(ValueError, match="nadir_at_zero"):
        rot_base_from_down(0.0, 0.0, 0.0, (0.0, 0.0, -2.0))
    with pytest.raises(ValueError, match="rays_down"):
        horizon_in_view(VIEW_1, np.zeros((3, 2)), np.eye(3)[None])
    with pytest.raises(ValueError, match="attitudes"):
        horizon_in_view(VIEW_1, cone_rays(RHO), np.eye(3))
    with pytest.raises(ValueError, match="altitude_m"):
        horizon_rays(Planet(limb_height_m=20e3), 10e3)
    with pytest.raises(ValueError, match="nadir_cam"):
        section_circle(np.zeros(3), RHO)
    with pytest.raises(ValueError, match="rho_rad"):
        section_circle(np.zeros((1, 3)), 0.0)


def test_no_attitudes_give_an_empty_answer():
    vis = horizon_in_view(VIEW_1, cone_rays(RHO), np.empty((0, 3, 3)))
    assert vis.fraction.shape == vis.visible.shape == (0,)


# ------------------------------------------------------------------ the paper's approximation


def nadir_in_camera(tilt: float, turn: float) -> np.ndarray:
    """Nadir (1, 3) of a camera whose axis is `tilt` below level and which is turned about it."""
    return np.array([[np.cos(tilt) * np.sin(turn), np.cos(tilt) * np.cos(turn), np.sin(tilt)]])


@given(tilt=st.floats(-0.2, 1.5), turn=angle)
def test_section_circle_touches_the_horizon_at_the_tangent_point(tilt, turn):
    nadir = nadir_in_camera(tilt, turn)
    circle = section_circle(nadir, RHO)
    # The horizon's point below (or above) the axis, seen at rho from nadir in the axis' own plane.
    down = nadir[0, :2] / np.linalg.norm(nadir[0, :2])
    offset = np.pi / 2 - tilt - RHO
    point = down * np.tan(offset)
    to_point = point - circle.centre[0]
    assert np.linalg.norm(to_point) == pytest.approx(circle.radius[0], rel=1e-9)
    # Tangent there: the radius runs along the line of symmetry.
    assert to_point[0] * down[1] - to_point[1] * down[0] == pytest.approx(0, abs=1e-9)


def test_section_circle_is_the_horizon_when_the_camera_looks_straight_down():
    circle = section_circle(np.array([[0.0, 0.0, 1.0]]), RHO)
    np.testing.assert_allclose(circle.centre, 0, atol=1e-12)
    assert circle.radius[0] == pytest.approx(np.tan(RHO), rel=1e-12)


def test_section_circle_curves_as_the_horizon_when_the_axis_touches_it():
    """A cone of half-angle rho cut square to a generator at distance 1 curves with tan rho."""
    circle = section_circle(nadir_in_camera(np.pi / 2 - RHO, 0.3), RHO)
    assert circle.radius[0] == pytest.approx(np.tan(RHO), rel=1e-12)


def test_section_circle_behind_the_camera_is_not_seen():
    nadir = nadir_in_camera(-0.9 * np.pi / 2, 0.0)
    fraction, length = section_circle_in_frame(nadir, RHO, 0.4, 0.3)
    assert np.isnan(section_circle(nadir, RHO).radius[0])
    assert fraction[0] == length[0] == 0


def test_triangle_areas_find_the_points_in_the_rectangle():
    """Eqs 9-13 against plain comparisons of the same points' coordinates."""
    rng = np.random.default_rng(3)
    nadir = nadir_in_camera(0.0, 0.0).repeat(200, axis=0)
    nadir = nadir + 0.3 * rng.standard_normal((200, 3))
    nadir /= np.linalg.norm(nadir, axis=1, keepdims=True)
    fraction, length = section_circle_in_frame(nadir, RHO, 0.4, 0.3, samples=720)
    circle = section_circle(nadir, RHO)
    t = 2 * np.pi * np.arange(720) / 720
    x, y = (
        centre[:, None] + circle.radius[:, None] * part
        for centre, part in zip(circle.centre.T, (np.cos(t), np.sin(t)), strict=True)
    )
    inside = (np.abs(x) <= 0.4) & (np.abs(y) <= 0.3)
    np.testing.assert_allclose(fraction, inside.mean(axis=1), atol=1e-12)
    assert np.count_nonzero(fraction) > 50
    seen = fraction > 0
    np.testing.assert_allclose(
        length[seen], 2 * np.pi * circle.radius[seen] * fraction[seen], rtol=1e-12
    )


def test_figure_6_by_the_section_circle_is_close_to_the_exact_one():
    yaw, pitch, attitudes = paper_map(1.5)
    exact = horizon_in_view(VIEW_1, cone_rays(RHO), attitudes)
    nadir = (VIEW_1.rot_base_from_cam.T @ attitudes)[:, :, 2]
    fraction, length = section_circle_in_frame(nadir, RHO, 320 / FOCAL, 240 / FOCAL)
    assert np.mean((fraction > 0) == exact.visible) > 0.998
    difference = (length * FOCAL - exact.arc_px)[exact.visible]
    assert np.sqrt(np.mean(difference**2)) < 3.0
    for sign in (1, -1):
        half = np.flatnonzero(np.sign(pitch) == sign)
        at = half[np.argmax(length[half])]
        assert yaw[at] == pytest.approx(19.6, abs=2.5)
        assert pitch[at] == pytest.approx(sign * 36.9, abs=2.5)
