"""Cameras against OpenCV's own projection, closed forms and finite differences."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView

WIDTH, HEIGHT = 640, 480
FX, FY, CX, CY = 420.0, 415.0, 318.3, 241.7
K = np.array([[FX, 0, CX], [0, FY, CY], [0, 0, 1]])
RATIONAL = (1.2, 0.5, 1e-3, -5e-4, 0.02, 1.5, 0.8, 0.1)
PRISM = (1e-3, -2e-3, 3e-3, 1e-3)
MODELS = {
    "pinhole": ("plumb_bob", ()),
    "plumb_bob 4": ("plumb_bob", (-0.25, 0.08, 1e-3, -5e-4)),
    "plumb_bob barrel": ("plumb_bob", (-0.3, 0.1, 1e-3, -2e-3, 0.02)),
    "plumb_bob pincushion": ("plumb_bob", (0.2, -0.05, 5e-4, 1e-3, 0.0)),
    "rational 8": ("rational_polynomial", RATIONAL),
    "rational 12": ("rational_polynomial", RATIONAL + PRISM),
    "rational 14": ("rational_polynomial", (*RATIONAL, *PRISM, 0.05, -0.03)),
    "equidistant": ("equidistant", (0.05, -0.01, 0.003, -0.001)),
    "equidistant 0": ("equidistant", ()),
}


def make(name: str) -> Camera:
    model, distortion = MODELS[name]
    return Camera(WIDTH, HEIGHT, FX, FY, CX, CY, model, distortion)


def frame_px(columns: int = 41, rows: int = 31) -> np.ndarray:
    """Pixels all over the frame, its very edge included."""
    x, y = np.meshgrid(
        np.linspace(-0.5, WIDTH - 0.5, columns), np.linspace(-0.5, HEIGHT - 0.5, rows)
    )
    return np.column_stack((x.ravel(), y.ravel()))


def opencv_pixels(camera: Camera, rays: np.ndarray) -> np.ndarray:
    points = np.ascontiguousarray(rays / rays[:, 2:])
    zero = np.zeros(3)
    if camera.model == "equidistant":
        coefficients = np.array(camera.distortion or (0.0,) * 4)
        return cv2.fisheye.projectPoints(points[None], zero, zero, K, coefficients)[0][0]
    coefficients = np.array(camera.distortion or (0.0,) * 5)
    return cv2.projectPoints(points, zero, zero, K, coefficients)[0][:, 0]


def opencv_normalised(camera: Camera, px: np.ndarray) -> np.ndarray:
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 1000, 1e-13)
    if camera.model == "equidistant":
        coefficients = np.array(camera.distortion or (0.0,) * 4)
        return cv2.fisheye.undistortPoints(px[:, None], K, coefficients, criteria=criteria)[:, 0]
    coefficients = np.array(camera.distortion or (0.0,) * 5)
    if hasattr(cv2, "undistortPointsIter"):
        return cv2.undistortPointsIter(px[:, None], K, coefficients, None, None, criteria)[:, 0]
    return cv2.undistortPoints(px[:, None], K, coefficients, criteria=criteria)[:, 0]


@pytest.mark.parametrize("name", MODELS)
def test_pixels_to_rays_and_back_agree_with_opencv_across_the_frame(name: str) -> None:
    camera = make(name)
    px = frame_px()
    rays = camera.rays(px)
    assert np.abs(np.linalg.norm(rays, axis=1) - 1).max() < 1e-14
    assert np.abs(camera.pixels(rays) - px).max() < 1e-6
    assert np.abs(camera.pixels(7.3 * rays) - px).max() < 1e-6
    assert np.abs(opencv_pixels(camera, rays) - px).max() < 1e-6


@pytest.mark.parametrize("name", MODELS)
def test_undistorted_points_agree_with_opencv(name: str) -> None:
    camera = make(name)
    px = frame_px()
    rays = camera.rays(px)
    error_px = (rays[:, :2] / rays[:, 2:] - opencv_normalised(camera, px)) * (FX, FY)
    assert np.abs(error_px).max() < 1e-6


@pytest.mark.parametrize("name", MODELS)
def test_jacobian_is_that_of_finite_differences(name: str) -> None:
    camera = make(name)
    rays = camera.rays(frame_px(11, 9))
    step = 1e-6
    numeric = np.stack(
        [(camera.pixels(rays + step * e) - camera.pixels(rays - step * e)) / (2 * step)
         for e in np.eye(3)],
        axis=-1,
    )  # fmt: skip
    jacobian = camera.pixel_jacobian(rays)
    assert np.abs(jacobian - numeric).max() < 1e-4 * FX / 100
    assert np.abs(np.einsum("ijk,ik->ij", jacobian, rays)).max() < 1e-9
    along = np.random.default_rng(0).normal(size=(len(rays), 2))
    expected = np.einsum("nij,ni->nj", jacobian, along)
    np.testing.assert_allclose(camera.pixel_gradients(rays, along), expected, atol=1e-9)


@pytest.mark.parametrize("name", ["equidistant", "equidistant 0", "pinhole", "rational 14"])
def test_jacobian_is_finite_on_the_axis(name: str) -> None:
    jacobian = make(name).pixel_jacobian(np.array([[0.0, 0.0, 1.0]]))
    assert np.all(np.isfinite(jacobian))
    assert abs(jacobian[0, 0, 0] - FX) < 0.05 * FX
    assert abs(jacobian[0, 1, 1] - FY) < 0.05 * FY


coefficient = st.floats(-0.4, 0.4)
small = st.floats(-0.01, 0.01)
pixels = st.tuples(st.floats(-50, WIDTH + 50), st.floats(-50, HEIGHT + 50))


@st.composite
def cameras(draw: st.DrawFn) -> Camera:
    model = draw(st.sampled_from(["plumb_bob", "rational_polynomial", "equidistant"]))
    if model == "equidistant":
        distortion = draw(st.tuples(*[st.floats(-0.1, 0.1)] * 4))
    else:
        distortion = draw(st.tuples(coefficient, coefficient, small, small, coefficient))
    if model == "rational_polynomial":
        distortion += draw(st.tuples(coefficient, coefficient, coefficient))
    focal = draw(st.floats(100, 2000))
    return Camera(WIDTH, HEIGHT, focal, focal * 1.01, CX, CY, model, distortion)


@settings(max_examples=200)
@given(cameras(), st.lists(pixels, min_size=1, max_size=20))
def test_any_pixel_has_its_own_ray_or_none(camera: Camera, px: list[tuple[float, float]]) -> None:
    array = np.array(px)
    rays = camera.rays(array)
    seen = np.isfinite(rays).all(axis=1)
    assert np.array_equal(np.isfinite(rays).any(axis=1), seen)
    angle = np.arctan2(np.hypot(rays[seen, 0], rays[seen, 1]), rays[seen, 2])
    assert np.all(angle <= camera.max_angle_rad * (1 + 1e-9))
    back = camera.pixels(rays[seen] * (1 - 1e-15))
    near_limit = angle > camera.max_angle_rad * (1 - 1e-9)
    assert np.abs((back - array[seen])[~near_limit]).max(initial=0.0) < 1e-6


@settings(max_examples=200)
@given(cameras(), st.floats(0, np.pi), st.floats(-np.pi, np.pi))
def test_any_ray_inside_the_field_survives_the_round_trip(
    camera: Camera, theta: float, azimuth: float
) -> None:
    ray = np.array(
        [[np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)]]
    )
    px = camera.pixels(ray)
    # Next to the fold the inverse is as ill-conditioned as the model itself.
    if theta < 0.98 * min(camera.max_angle_rad, 1.5 if camera.model != "equidistant" else np.pi):
        assert np.abs(camera.rays(px) - ray).max() < 1e-7
    if theta > camera.max_angle_rad * (1 + 1e-9):
        assert np.isnan(px).all()


def test_outside_the_one_to_one_field_there_is_nothing() -> None:
    # r (1 - 0.5 r^2) turns back at r = sqrt(2/3), where it reaches 0.544.
    camera = Camera(WIDTH, HEIGHT, 300.0, 300.0, CX, CY, "plumb_bob", (-0.5, 0.0, 0.0, 0.0))
    fold = np.sqrt(2 / 3)
    assert camera.max_angle_rad == pytest.approx(np.arctan(fold), abs=1e-12)
    rays = np.array([[fold * 0.999, 0, 1], [fold * 1.001, 0, 1], [1.3, 0, 1]])
    assert np.isfinite(camera.pixels(rays)).all(axis=1).tolist() == [True, False, False]
    reach = 300.0 * fold * (1 - 0.5 * fold**2)
    px = np.array([[CX + reach - 0.01, CY], [CX + reach + 0.01, CY], [CX + 2 * reach, CY]])
    found = camera.rays(px)
    assert np.isfinite(found).all(axis=1).tolist() == [True, False, False]
    assert found[0, 0] / found[0, 2] < fold
    assert camera.pixels(found[:1]) == pytest.approx(px[:1], abs=1e-6)


def test_fold_by_tangential_distortion_is_found() -> None:
    camera = Camera(WIDTH, HEIGHT, 300.0, 300.0, CX, CY, "plumb_bob", (0.0, 0.0, 0.0, 0.1, 0.0))
    # x' = x + 0.1 (r^2 + 2 x^2) along y = 0 has slope 1 + 0.6 x.
    assert np.tan(camera.max_angle_rad) == pytest.approx(1 / 0.6, rel=1e-6)


def test_rational_model_stops_at_its_pole() -> None:
    camera = Camera(
        WIDTH, HEIGHT, 300.0, 300.0, CX, CY, "rational_polynomial", (0, 0, 0, 0, 0, -1.0, 0, 0)
    )
    assert camera.max_angle_rad == pytest.approx(np.pi / 4)


def test_equidistant_sees_behind_itself() -> None:
    camera = Camera(1000, 1000, 150.0, 150.0, 499.5, 499.5, "equidistant")
    theta = np.radians([10.0, 90.0, 120.0, 179.0])
    rays = np.column_stack((np.sin(theta), np.zeros(4), np.cos(theta)))
    px = camera.pixels(rays)
    assert px[:, 0] == pytest.approx(499.5 + 150.0 * theta, abs=1e-9)
    assert camera.rays(px) == pytest.approx(rays, abs=1e-12)
    assert np.isnan(camera.pixels(np.array([[0.0, 0.0, -1.0]]))).all()
    distorted = Camera(1000, 1000, 150.0, 150.0, 499.5, 499.5, "equidistant", (0.01, 0, 0, 0))
    expected = 499.5 + 150.0 * theta[:3] * (1 + 0.01 * theta[:3] ** 2)
    assert distorted.pixels(rays[:3])[:, 0] == pytest.approx(expected, abs=1e-9)


def test_rays_behind_a_perspective_camera_have_no_pixel() -> None:
    rays = np.array([[0.1, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [np.nan, 0.0, 1.0]])
    for name in ("pinhole", "plumb_bob barrel", "rational 14"):
        px, jacobian = make(name).project(rays)
        assert np.isnan(px).all()
        assert np.isnan(make(name).pixels(rays)).all()
        assert np.isnan(jacobian[:2]).any(axis=(1, 2)).all()


@pytest.mark.parametrize("name", MODELS)
def test_pixels_move_along_as_their_jacobian_says(name: str) -> None:
    camera = make(name)
    rng = np.random.default_rng(2)
    rays = camera.rays(rng.uniform(100.0, 300.0, (50, 2)))
    along = rng.normal(size=rays.shape)
    px, moved = camera.project_along(rays, along)
    again, jacobian = camera.project(rays)
    np.testing.assert_allclose(px, again, rtol=1e-12)
    np.testing.assert_allclose(moved, np.einsum("nij,nj->ni", jacobian, along), rtol=1e-9)
    # One that is behind the camera, or no ray, changes nothing for the others.
    rays[1], rays[2] = -rays[1] if "equidistant" not in name else np.nan, np.nan
    beside = camera.project_along(rays, along)[0]
    np.testing.assert_array_equal(beside[3:], px[3:])
    assert np.isnan(beside[1:3]).all()


@pytest.mark.parametrize("name", MODELS)
def test_bad_pixels_and_no_pixels(name: str) -> None:
    camera = make(name)
    rays = camera.rays(np.array([[np.nan, 1.0], [np.inf, 2.0], [100.0, 100.0]]))
    assert np.isfinite(rays).all(axis=1).tolist() == [False, False, True]
    no_rays = np.array([[np.inf, 0.0, 1.0], [np.nan, 0.0, 1.0]])
    assert np.isnan(camera.pixels(no_rays)).all()
    assert camera.rays(np.empty((0, 2))).shape == (0, 3)
    assert camera.pixels(np.empty((0, 3))).shape == (0, 2)
    assert camera.pixel_jacobian(np.empty((0, 3))).shape == (0, 2, 3)
    with pytest.raises(ValueError, match="px must have shape"):
        camera.rays(np.zeros(2))


def test_roi_and_binning_keep_every_ray_where_its_block_of_pixels_is() -> None:
    full = Camera(1280, 960, 800.0, 790.0, 645.0, 470.0, "plumb_bob", (-0.1, 0.02, 0, 0, 0))
    k = (800.0, 0, 645.0, 0, 790.0, 470.0, 0, 0, 1)
    camera = Camera.from_calibration(
        1280, 960, k, "plumb_bob", (-0.1, 0.02, 0, 0, 0), 2, 4, (100, 40, 600, 800)
    )
    assert (camera.width, camera.height) == (300, 200)
    # Delivered pixel (7, 5) averages the full-resolution columns 114, 115 and rows 60 to 63.
    block_centre = np.array([[np.mean([114, 115]), np.mean([60, 61, 62, 63])]])
    assert camera.rays(np.array([[7.0, 5.0]])) == pytest.approx(full.rays(block_centre), abs=1e-12)


def test_calibration_defaults_mean_the_full_frame() -> None:
    k = np.array(K)
    plain = Camera.from_calibration(WIDTH, HEIGHT, k, "equidistant", [0.1, 0, 0, 0])
    assert plain == Camera(WIDTH, HEIGHT, FX, FY, CX, CY, "equidistant", (0.1, 0, 0, 0))
    whole = Camera.from_calibration(
        WIDTH, HEIGHT, k.ravel(), "equidistant", [0.1, 0, 0, 0], 1, 1, (0, 0, WIDTH, HEIGHT)
    )
    assert whole == plain
    assert Camera.from_calibration(WIDTH, HEIGHT, k, "", []).model == "plumb_bob"


def changed(index: int, value: float) -> np.ndarray:
    k = K.ravel().copy()
    k[index] = value
    return k


@pytest.mark.parametrize(
    ("k", "model", "distortion", "options", "message"),
    [
        (changed(0, 0.0), "plumb_bob", [], {}, "uncalibrated"),
        (changed(0, -5.0), "plumb_bob", [], {}, "uncalibrated"),
        (changed(4, 0.0), "plumb_bob", [], {}, "positive"),
        (changed(2, np.nan), "plumb_bob", [], {}, "non-finite"),
        (changed(1, 3.0), "plumb_bob", [], {}, "not of the form"),
        (np.ones(8), "plumb_bob", [], {}, "9 elements"),
        (K, "fisheye", [0, 0, 0, 0], {}, "unknown distortion model 'fisheye'"),
        (K, "", [0, 0, 0, 0], {}, "unknown distortion model ''"),
        (K, "plumb_bob", [0.1, 0.2, 0.3], {}, "takes 0 or 4 or 5 coefficients, got 3"),
        (K, "rational_polynomial", [0.1] * 5, {}, "0 or 8 or 12 or 14 coefficients, got 5"),
        (K, "equidistant", [0.1] * 5, {}, "0 or 4 coefficients, got 5"),
        (K, "equidistant", [0.1, 0, 0, np.inf], {}, "finite"),
        (K, "plumb_bob", [], {"roi": (600, 0, 100, 100)}, "not inside"),
        (K, "plumb_bob", [], {"roi": (0, 0, 100, 0)}, "not inside"),
        (K, "plumb_bob", [], {"binning_x": -1}, "negative"),
        (K, "plumb_bob", [], {"binning_y": 1000}, "image size must be positive"),
    ],
)
def test_a_bad_calibration_is_refused_in_words(
    k: np.ndarray, model: str, distortion: list[float], options: dict, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        Camera.from_calibration(WIDTH, HEIGHT, k, model, distortion, **options)


def test_a_calibration_without_a_size_says_so() -> None:
    with pytest.raises(ValueError, match="width and height must be positive, got 0 x 480"):
        Camera.from_calibration(0, HEIGHT, K, "plumb_bob", [])


@pytest.mark.parametrize("width", [640.5, np.nan, np.inf])
def test_a_size_that_is_no_number_of_pixels_says_so(width: float) -> None:
    with pytest.raises(ValueError, match=f"whole pixels, got {width} x 480"):
        Camera(width, HEIGHT, 500.0, 500.0, 320.0, 240.0)  # type: ignore[arg-type]


def test_in_frame_is_the_image_area() -> None:
    px = np.array([[-0.5, -0.5], [-0.51, 0], [639.49, 479.49], [639.5, 0], [np.nan, 0]])
    assert make("pinhole").in_frame(px).tolist() == [True, False, True, False, False]


def test_view_takes_only_rotations() -> None:
    view = CameraView("left", make("pinhole"), np.eye(3))
    assert not view.rot_base_from_cam.flags.writeable
    for bad in (np.diag([1, 1, -1]), 2 * np.eye(3), np.full((3, 3), np.nan), np.eye(2)):
        with pytest.raises(ValueError, match="rot_base_from_cam of 'left'"):
            CameraView("left", make("pinhole"), bad)


def test_beside_a_pole_of_the_lens_model_there_are_no_rays_or_right_ones() -> None:
    """Newton's steps are small there wherever they lead: 512 pixels had the ray of the pole."""
    lens = (-1.082, -0.138, -0.011, -0.064, -0.063, -0.51, -0.594, -0.388)
    camera = Camera(320, 240, 155.0, 155.0, 160.0, 118.0, "rational_polynomial", lens)
    x, y = np.meshgrid(np.arange(0.0, 320.0, 4.0), np.arange(0.0, 240.0, 4.0))
    px = np.stack([x.ravel(), y.ravel()], axis=1)
    rays = camera.rays(px)
    found = np.isfinite(rays[:, 0])
    assert 0.5 < np.mean(found) < 1.0
    np.testing.assert_allclose(camera.pixels(rays[found]), px[found], atol=1e-3)


def test_rays_below_a_pole_of_the_lens_model() -> None:
    """The table of radii ended beyond the pole, and every search in it began there."""
    lens = (*(0.0,) * 7, -0.0234375)
    camera = Camera(640, 480, 100.0, 101.0, 318.3, 241.7, "rational_polynomial", lens)
    for angle_rad in (0.3, 0.7, 1.0):
        ray = np.array([[np.sin(angle_rad), 0.0, np.cos(angle_rad)]])
        np.testing.assert_allclose(camera.rays(camera.pixels(ray)), ray, atol=1e-9)
