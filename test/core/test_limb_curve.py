"""The limb's curve in the image against the closed form of the cone, and OpenCV's own lenses."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from limb_samples import CAMERAS, FISHEYE, PINHOLE, cone_rays, view_at_limb
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb_curve import LimbCurve, limb_curve

NADIR = np.array([0.3, -0.5, 0.81]) / np.linalg.norm([0.3, -0.5, 0.81])
RHOS = [np.radians(5.0), np.radians(42.0), np.radians(67.0), np.radians(84.0)]

directions = (
    st.tuples(*[st.floats(-1, 1)] * 3)
    .filter(lambda v: np.linalg.norm(v) > 0.1)
    .map(lambda v: np.array(v) / np.linalg.norm(v))
)


def opencv_rays(camera: Camera, px: np.ndarray) -> np.ndarray:
    """Unit rays (N, 3) of raw pixels by OpenCV's own inversion of the lens."""
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-14)
    points, distortion = px[:, None], np.array(camera.distortion or (0.0,) * 4)
    if camera.model == "equidistant":
        # OpenCV gives tangents; the angle is found by its own polynomial, so any field will do.
        scaled = (px - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
        radius = np.linalg.norm(scaled, axis=1)
        theta = radius.copy()
        for _ in range(200):
            powers = theta[:, None] ** (2 * np.arange(1, 5))
            theta = radius / (1 + powers @ distortion)
        unit = scaled / np.maximum(radius, 1e-300)[:, None]
        return np.column_stack([np.sin(theta)[:, None] * unit, np.cos(theta)])
    if hasattr(cv2, "undistortPointsIter"):  # OpenCV 4
        normalised = cv2.undistortPointsIter(points, matrix, distortion, None, None, criteria)
    else:
        normalised = cv2.undistortPoints(points, matrix, distortion, criteria=criteria)
    normalised = normalised[:, 0]
    rays = np.column_stack([normalised, np.ones(len(normalised))])
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def visible_length_px(view: CameraView, nadir: np.ndarray, rho: float) -> float:
    """Length of the limb in the frame, from points of the cone that lie very close together."""
    azimuth = np.linspace(-np.pi, np.pi, 40001)
    px = view.camera.pixels(cone_rays(nadir, rho, azimuth) @ view.rot_base_from_cam)
    seen = view.camera.in_frame(px)
    return float(np.linalg.norm(np.diff(px, axis=0), axis=1)[seen[1:] & seen[:-1]].sum())


def arcs_spacing(curve: LimbCurve, spacing: float) -> np.ndarray:
    """Distances between neighbours, without the jumps from one visible arc to the next."""
    step = np.linalg.norm(np.diff(curve.px, axis=0), axis=1)
    return step[step < 3.0 * spacing]


@pytest.mark.parametrize("rho", RHOS)
def test_pinhole_limb_is_the_cones_conic(rho: float) -> None:
    view = view_at_limb(PINHOLE, NADIR, rho, 0.7, 0.4)
    curve = limb_curve(view, NADIR, rho)
    assert len(curve) > 80
    # u^T (n n^T - cos^2 rho I) u = 0 with u = K^-1 x is a conic of the image.
    inverse = np.linalg.inv([[PINHOLE.fx, 0, PINHOLE.cx], [0, PINHOLE.fy, PINHOLE.cy], [0, 0, 1.0]])
    nadir = view.rot_base_from_cam.T @ NADIR
    conic = inverse.T @ (np.outer(nadir, nadir) - np.cos(rho) ** 2 * np.eye(3)) @ inverse
    x = np.column_stack([curve.px, np.ones(len(curve))])
    polar = x @ conic
    gradient = 2.0 * polar[:, :2]
    size = np.linalg.norm(gradient, axis=1)
    assert np.abs(np.sum(polar * x, axis=1) / size).max() < 1e-8
    # The conic's form is positive inside the disc: space lies against its gradient.
    np.testing.assert_allclose(curve.normal_px, -gradient / size[:, None], atol=1e-9)
    assert np.all(x @ inverse.T @ nadir > 0)


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda c: c.model + str(len(c.distortion)))
@pytest.mark.parametrize("rho", RHOS)
def test_lenses_agree_with_opencv(camera: Camera, rho: float) -> None:
    view = view_at_limb(camera, NADIR, rho, -2.0, 1.1)
    curve = limb_curve(view, NADIR, rho, spacing_px=2.0)
    # clear of the fisheye's corners, where it begins to fold
    size = np.array([camera.width - 1.0, camera.height - 1.0])
    clear = ((curve.px >= 60.0) & (curve.px <= size - 60.0)).all(axis=1)
    curve = replace(curve, px=curve.px[clear], normal_px=curve.normal_px[clear])
    assert len(curve) > 30
    nadir = view.rot_base_from_cam.T @ NADIR

    def angle(px: np.ndarray) -> np.ndarray:
        return np.arccos(opencv_rays(camera, px) @ nadir)

    np.testing.assert_allclose(angle(curve.px), rho, atol=2e-8)
    out, back = (angle(curve.px + s * 0.5 * curve.normal_px) for s in (1, -1))
    assert np.all(out > back)
    # Across the limb: along the tangent the angle stays.
    tangent = curve.normal_px[:, ::-1] * [1, -1]
    ahead, behind = (angle(curve.px + s * 0.1 * tangent) for s in (1, -1))
    assert np.abs((ahead - behind) / 0.2 / (out - back)).max() < 1e-3


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda c: c.model + str(len(c.distortion)))
@pytest.mark.parametrize("spacing", [1.0, 4.0])
def test_points_are_evenly_spaced(camera: Camera, spacing: float) -> None:
    for rho in RHOS:
        view = view_at_limb(camera, NADIR, rho, 0.2, 0.0)
        curve = limb_curve(view, NADIR, rho, spacing_px=spacing)
        step = arcs_spacing(curve, spacing)
        assert np.abs(step / spacing - 1.0).max() < 0.05
        assert len(curve) * spacing == pytest.approx(
            visible_length_px(view, NADIR, rho), abs=4 * spacing, rel=0.01
        )


@pytest.mark.parametrize("camera", CAMERAS[:2], ids=lambda c: c.model + str(len(c.distortion)))
def test_a_limb_that_moves_on_reaches_the_frames_border_all_the_time(camera: Camera) -> None:
    """Azimuths are kept from one drawing to the next while the limb moves by little."""
    rho = np.radians(66.0)
    view = view_at_limb(camera, NADIR, rho, 0.3, 0.0)
    size = np.array([camera.width - 1.0, camera.height - 1.0])
    for turn in np.linspace(0.0, 0.02, 41):
        axis = np.cross(NADIR, view.rot_base_from_cam[:, 2])
        nadir = Rotation.from_rotvec(turn * axis).apply(NADIR)
        curve = limb_curve(view, nadir, rho + 0.3 * turn)
        ends = curve.px[[0, -1]]
        assert np.minimum(ends, size - ends).min(axis=1).max() < 2.0
        rays = camera.rays(curve.px) @ view.rot_base_from_cam.T
        np.testing.assert_allclose(np.arccos(rays @ nadir), rho + 0.3 * turn, atol=1e-7)


@pytest.mark.parametrize("rho", [0.0, np.nan, 1e-9])
def test_no_disc_has_no_limb(rho: float) -> None:
    """A track may predict none."""
    view = view_at_limb(PINHOLE, NADIR, 0.5, 0.3, 0.0)
    assert len(limb_curve(view, NADIR, rho)) == 0
    assert len(limb_curve(view, np.full(3, np.nan), 0.5)) == 0


def test_whole_disc_is_a_closed_curve() -> None:
    rho = np.radians(12.0)
    view = CameraView("camera", PINHOLE, Rotation.from_rotvec([0.1, 0.05, 0.0]).as_matrix())
    nadir = np.array([0.0, 0.0, 1.0])
    curve = limb_curve(view, nadir, rho)
    gap = np.linalg.norm(np.diff(curve.px, axis=0, append=curve.px[:1]), axis=1)
    assert gap.max() < 1.6


def test_straight_down_in_the_middle_of_the_frame() -> None:
    """Nadir on the optical axis: no azimuth is nearest to it. A circle of radius f tan(rho)."""
    camera = Camera(641, 641, 400.0, 400.0, 320.0, 320.0)
    curve = limb_curve(CameraView("down", camera, np.eye(3)), np.array([0.0, 0.0, 1.0]), 0.6)
    radius = np.linalg.norm(curve.px - 320.0, axis=1)
    np.testing.assert_allclose(radius, 400.0 * np.tan(0.6), atol=1e-9)
    np.testing.assert_allclose(curve.normal_px, (curve.px - 320.0) / radius[:, None], atol=1e-9)
    assert len(curve) == pytest.approx(2 * np.pi * 400.0 * np.tan(0.6), abs=3)


@pytest.mark.parametrize("offset_deg", [-60.0, 60.0, 110.0])
def test_limb_out_of_the_frame_is_empty(offset_deg: float) -> None:
    rho = np.radians(62.0)
    view = view_at_limb(PINHOLE, NADIR, rho, 1.0, 0.0, np.radians(offset_deg))
    curve = limb_curve(view, NADIR, rho)
    assert len(curve) == 0
    assert curve.px.shape == curve.normal_px.shape == (0, 2)


@settings(max_examples=100)
@given(
    directions,
    st.floats(np.radians(3.0), np.radians(87.0)),
    st.sampled_from(CAMERAS),
    st.tuples(*[st.floats(-np.pi, np.pi)] * 3),
    st.floats(0.5, 8.0),
)
def test_at_any_attitude_the_limb_lies_on_its_cone_in_the_frame(
    nadir: np.ndarray,
    rho: float,
    camera: Camera,
    euler: tuple[float, float, float],
    spacing: float,
) -> None:
    view = CameraView("camera", camera, Rotation.from_euler("zyx", euler).as_matrix())
    curve = limb_curve(view, nadir, rho, spacing_px=spacing)
    size = np.array([camera.width - 1.0, camera.height - 1.0])
    assert np.all((curve.px >= 0.0) & (curve.px <= size))
    np.testing.assert_allclose(np.linalg.norm(curve.normal_px, axis=1), 1.0, atol=1e-12)
    nadir_cam = view.rot_base_from_cam.T @ nadir
    np.testing.assert_allclose(np.arccos(camera.rays(curve.px) @ nadir_cam), rho, atol=1e-7)
    out = camera.rays(curve.px + 0.01 * curve.normal_px)
    out = out[np.isfinite(out).all(axis=1)]
    assert np.all(np.arccos(np.clip(out @ nadir_cam, -1, 1)) > rho)
    # Far off a fisheye's axis a coarse cell may be entered at one end only.
    if len(step := arcs_spacing(curve, spacing)) > 20:
        assert np.median(np.abs(step / spacing - 1.0)) < 0.1
    length = visible_length_px(view, nadir, rho)
    # the fisheye's image may end within one coarse cell of the curve
    assert len(curve) * spacing == pytest.approx(length, abs=40.0 + 2 * spacing, rel=0.03)


def test_fisheye_sees_limb_behind_its_image_plane() -> None:
    rho = np.radians(80.0)
    camera = Camera(640, 640, 180.0, 180.0, 320.0, 320.0, "equidistant")
    view = view_at_limb(camera, NADIR, rho, 0.0, 0.0, np.radians(20.0))
    curve = limb_curve(view, NADIR, rho)
    rays = camera.rays(curve.px)
    assert (rays[:, 2] < 0).any()
    assert len(curve) == pytest.approx(visible_length_px(view, NADIR, rho), abs=4)
    assert FISHEYE.model == camera.model
