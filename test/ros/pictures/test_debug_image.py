"""The debug image: what is drawn, where, and that colour-blind people can tell it apart."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import cv2
import numpy as np
import pytest
from horizon_messages import (
    CAMERAS,
    FOCAL_PX,
    HEIGHT,
    RHO_RAD,
    ROTATIONS,
    WIDTH,
    horizon_gray,
    nadir_of,
)
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.planet_figure import disc_of
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.ros.pictures.canvas import (
    BLUISH_GREEN,
    LIGHT_GREEN,
    PURPLE,
    SKY_BLUE,
    VERMILLION,
    YELLOW,
)
from horizon_sensor_ros.ros.pictures.debug_image import draw_fix, sigma_in_frame

CAMERA = Camera(WIDTH, HEIGHT, FOCAL_PX, FOCAL_PX, (WIDTH - 1) / 2, (HEIGHT - 1) / 2)
NADIR = nadir_of(3.0, -2.0)
Frames = tuple[Frame, ...]
turns = st.tuples(*[st.floats(-3.1, 3.1)] * 3).map(lambda v: Rotation.from_rotvec(v).as_matrix())


@pytest.fixture(scope="module")
def pair() -> tuple[Frames, HorizonFix]:
    """Two cameras' frames with a fix."""
    frames = tuple(
        Frame(CameraView(name, CAMERA, ROTATIONS[name]), horizon_gray(name, NADIR))
        for name in CAMERAS
    )
    fix = HorizonSensor().process(frames)
    assert fix.ok
    return frames, fix


def places(picture: np.ndarray, colour: tuple[int, int, int], top: int = 0) -> np.ndarray:
    """(N, 2) x, y of the pixels of this colour, of at least half its strength; y below `top`."""
    part = picture[top:].astype(float)
    strength = part @ np.array(colour) / np.dot(colour, colour)
    off = np.abs(part - strength[..., None] * np.array(colour)).max(axis=2)
    y, x = np.nonzero((strength > 0.5) & (strength < 1.1) & (off < 12))
    return np.column_stack([x, y + top])


def distance_px(view: CameraView, fix: HorizonFix, at: np.ndarray) -> np.ndarray:
    """Distance of places in a picture of twice the frame's size from the fitted limb."""
    limb = disc_of(fix.fit).limb_px(view, 1441)
    limb = limb[np.isfinite(limb).all(axis=1)] * 2 + 0.5
    return np.array([np.linalg.norm(limb - p, axis=1).min() for p in at])


def test_points_and_limb_are_drawn_where_they_are(pair: tuple[Frames, HorizonFix]) -> None:
    frames, fix = pair
    picture = draw_fix(frames, fix)
    # A small frame is drawn larger, 640 wide.
    assert picture.shape == (480, 1280, 3)
    for i, frame in enumerate(frames):
        tile = picture[:, 640 * i : 640 * (i + 1)]
        for colour in (YELLOW, SKY_BLUE):
            drawn = places(tile, colour, top=60)
            assert len(drawn) > 50
            assert distance_px(frame.view, fix, drawn).max() < 5.0
        assert len(places(tile, PURPLE, top=60)) > 50
    strip = picture[:30]
    assert len(places(strip, BLUISH_GREEN)) > 500
    assert len(places(strip, VERMILLION)) == 0


def test_points_thrown_away_are_marked(pair: tuple[Frames, HorizonFix]) -> None:
    frames, fix = pair
    limb = fix.limbs[0]
    px = limb.px.copy()
    off = [10, len(px) // 2]
    px[off] += 12.0 * limb.normal_px[off]
    bad = replace(fix, limbs=(replace(limb, px=px), fix.limbs[1]))
    marks = places(draw_fix(frames, bad)[:, :640], VERMILLION, top=60)
    where = np.array([np.linalg.norm(marks - (2 * px[i] + 0.5), axis=1) for i in off])
    assert where.min(axis=1).max() < 3.0


def test_the_limb_is_dashed_where_no_point_supports_it(pair: tuple[Frames, HorizonFix]) -> None:
    frames, fix = pair
    none = LimbPoints.none(Status.NO_LIMB, "faint limb")
    alone = replace(fix, limbs=(none, fix.limbs[1]), cameras_used=(CAMERAS[1],))
    picture = draw_fix(frames, alone)[:, :640]
    drawn = places(picture, SKY_BLUE, top=60)
    limb = disc_of(fix.fit).limb_px(frames[0].view, 1441)
    limb = limb[frames[0].view.camera.in_frame(limb)] * 2 + 0.5
    limb = limb[limb[:, 1] > 60]
    on_line = [np.linalg.norm(drawn - place, axis=1).min() < 1.5 for place in limb]
    assert 0.3 < np.mean(on_line) < 0.7
    assert len(places(picture[:30], VERMILLION)) > 500, "left out"


def test_the_airglows_edge_is_drawn_where_the_fix_is_by_it_too(
    pair: tuple[Frames, HorizonFix],
) -> None:
    frames, fix = pair
    above = replace(fix.fit, rho_rad=fix.fit.rho_rad + 0.06)
    picture = draw_fix(frames, replace(fix, airglow=above))[:, :640]
    layer = replace(fix.fit, disc=replace(disc_of(fix.fit), rho_rad=above.rho_rad))
    # Each in its own colour.
    for fit, colour in ((fix.fit, SKY_BLUE), (layer, LIGHT_GREEN)):
        drawn = places(picture, colour, top=60)
        assert len(drawn) > 50
        assert (distance_px(frames[0].view, replace(fix, fit=fit), drawn) < 5.0).all()


def test_a_limb_that_is_followed_shows_where_it_was_expected(
    pair: tuple[Frames, HorizonFix],
) -> None:
    frames, _ = pair
    sensor = HorizonSensor()
    fixes = [sensor.process(frames) for _ in range(2)]
    assert fixes[0].predicted is None
    disc = fixes[1].predicted
    assert disc is not None
    # The craft stood still: it is expected where it was.
    np.testing.assert_allclose(disc.nadir, fixes[0].fit.nadir_base, atol=1e-9)
    # Off the limb, as after a turn that nobody foresaw, its dots are seen.
    off = replace(fixes[1], predicted=replace(disc, rho_rad=disc.rho_rad + 0.05))
    plain, drawn = (draw_fix(frames, f) for f in (fixes[0], off))
    x, y = np.rint(off.predicted.limb_px(frames[0].view, 2000) * 2 + 0.5).T
    inside = (x > 5) & (x < 634) & (y > 70) & (y < 475)
    along = [p[y[inside].astype(int), x[inside].astype(int)].astype(int) for p in (drawn, plain)]
    assert 0.1 < np.mean(np.abs(along[0] - along[1]).max(axis=1) > 30) < 0.9


def test_a_refused_frame_says_so_and_shows_no_answer(pair: tuple[Frames, HorizonFix]) -> None:
    frames, _ = pair
    dark = tuple(replace(frame, gray=np.zeros((HEIGHT, WIDTH), np.uint8)) for frame in frames)
    fix = HorizonSensor().process(dark)
    assert not fix.ok
    picture = draw_fix(dark, fix)
    assert len(places(picture[:30], VERMILLION)) > 500
    for colour in (SKY_BLUE, YELLOW, PURPLE):
        assert len(places(picture, colour)) == 0
    # The reason is written: white letters in the strip, and nothing below it.
    assert np.any(picture[:30] == 255)
    assert not picture[80:].any()


def test_a_very_long_reason_stays_in_the_picture(pair: tuple[Frames, HorizonFix]) -> None:
    frames, _ = pair
    dark = tuple(replace(frame, gray=np.zeros((HEIGHT, WIDTH), np.uint8)) for frame in frames)
    fix = replace(HorizonSensor().process(dark), reason="für nothing " * 30)
    picture = draw_fix(dark, fix)
    # Nothing is written over the tile's right edge.
    assert not picture[:, 636:640].any()
    assert len(np.flatnonzero((picture[:, :640] > 150).any(axis=(1, 2)))) > 40


@pytest.mark.parametrize(("width", "drawn"), [(64, 640), (640, 640), (700, 700), (2048, 800)])
def test_the_pictures_width(width: int, drawn: int) -> None:
    camera = Camera(width, width * 3 // 4, width * 0.8, width * 0.8, width / 2, width * 3 / 8)
    gray = np.full((camera.height, width), 60000, np.uint16)
    frames = (Frame(CameraView("camera_1", camera, np.eye(3)), gray),)
    picture = draw_fix(frames, HorizonSensor().process(frames))
    assert picture.dtype == np.uint8
    assert picture.shape == (round(drawn * 0.75), drawn, 3)


@pytest.mark.parametrize("size", [(2000, 16), (16, 2000), (20000, 1), (1, 20000), (3, 3)])
def test_frames_of_any_shape_are_drawn(size: tuple[int, int]) -> None:
    width, height = size
    camera = Camera(width, height, 1e3, 1e3, width / 2, height / 2)
    frames = (
        Frame(CameraView("camera_1", camera, np.eye(3)), np.zeros((height, width), np.uint8)),
    )
    fix = HorizonSensor().process(frames)
    assert fix.status is Status.BAD_IMAGE
    assert 0.04e6 < draw_fix(frames, fix)[..., 0].size < 2e6


@given(
    rot=turns,
    model=st.sampled_from([("plumb_bob", (-0.35, 0, 0, 0)), ("equidistant", (-0.05, 0, 0, 0))]),
)
def test_a_limb_that_leaves_the_lenses_field_inside_the_frame_is_drawn(
    pair: tuple[Frames, HorizonFix], rot: np.ndarray, model: tuple[str, tuple[float, ...]]
) -> None:
    """A lens that folds, its corners dark: the limb ends there, and so do its line and its dots."""
    frames, fix = pair
    camera = Camera(WIDTH, HEIGHT, 0.5 * WIDTH, 0.5 * WIDTH, WIDTH / 2, HEIGHT / 2, *model)
    folding = replace(frames[0], view=CameraView(CAMERAS[0], camera, rot))
    followed = replace(fix, predicted=disc_of(fix.fit))
    picture = draw_fix((folding, frames[1]), followed)
    assert picture.shape == (480, 1280, 3)
    drawn = places(picture[:, :640], SKY_BLUE, top=60)
    limb = disc_of(fix.fit).limb_px(folding.view, 1441)
    shown = limb[camera.in_frame(limb)] * 2 + 0.5
    # Neither below the words nor below the ellipse.
    clear = (shown[:, 1] > 80) & ((shown < (460, 300)).any(axis=1))
    assert len(drawn) >= 0.1 * np.count_nonzero(clear)
    assert len(drawn) == 0 or distance_px(folding.view, followed, drawn).max() < 5.0


def test_of_a_limb_that_passes_beside_a_camera_nothing_is_drawn(
    pair: tuple[Frames, HorizonFix],
) -> None:
    frames, fix = pair
    # Nadir straight ahead and a limb 90 deg from it: no pixel is that far out, nor any integer.
    fit = replace(fix.fit, nadir_base=ROTATIONS["camera_1"][:, 2], rho_rad=np.pi / 2, disc=None)
    with np.errstate(invalid="raise"):
        picture = draw_fix(frames, replace(fix, fit=fit))
    tile, other = picture[:, :640], picture[:, 640:]
    assert len(places(tile, SKY_BLUE, top=60)) == 0
    ((x, y),) = CAMERA.pixels(np.array([[0.0, 0.0, 1.0]])) * 2 + 0.5
    assert tile[round(y), round(x)].tolist() == [255, 255, 255], "the cross of nadir"
    # The camera that looks across sees half of it.
    drawn = places(other, SKY_BLUE, top=60)
    assert len(drawn) > 50
    assert distance_px(frames[1].view, replace(fix, fit=fit), drawn).max() < 5.0


def test_nadir_in_the_frame_is_a_cross(pair: tuple[Frames, HorizonFix]) -> None:
    frames, fix = pair
    looking_down = CameraView(
        CAMERAS[0], CAMERA, Rotation.align_vectors([NADIR], [[0, 0, 1]])[0].as_matrix()
    )
    frame = replace(frames[0], view=looking_down, gray=np.zeros((HEIGHT, WIDTH), np.uint8))
    picture = draw_fix((frame, frames[1]), fix)[:, :640]
    ((x, y),) = CAMERA.pixels((fix.fit.nadir_base @ looking_down.rot_base_from_cam)[None]) * 2 + 0.5
    assert picture[round(y), round(x)].tolist() == [255, 255, 255]


@given(rot=turns, sigma=st.tuples(st.floats(1e-5, 1e-2), st.floats(1e-5, 1e-2)))
def test_the_ellipse_has_nadirs_sigmas(
    pair: tuple[Frames, HorizonFix], rot: np.ndarray, sigma: tuple[float, float]
) -> None:
    _, fix = pair
    nadir = fix.fit.nadir_base
    axes = np.linalg.svd(nadir[None])[2][1:]
    cov = np.zeros((4, 4))
    cov[:3, :3] = sum(s * s * np.outer(a, a) for s, a in zip(sigma, axes, strict=True))
    fit = replace(fix.fit, cov_nadir_altitude=cov)
    found = sigma_in_frame(CameraView("camera_1", CAMERA, rot), fit)
    np.testing.assert_allclose(
        np.sqrt(np.linalg.eigvalsh(found)), np.sort(sigma), rtol=1e-4, atol=1e-9
    )


def test_the_ellipse_lies_as_the_camera_sees_it() -> None:
    # Nadir 90 deg to the right of a camera that looks along x: it moves in y (left) not at all to
    # first order, up and down by what is uncertain about the optical axis.
    sensor = HorizonSensor()
    frames = tuple(
        Frame(CameraView(name, CAMERA, ROTATIONS[name]), horizon_gray(name, NADIR))
        for name in CAMERAS
    )
    fit = sensor.process(frames).fit
    cov = np.zeros((4, 4))
    # Sideways for the first camera, which looks forward: along the base frame's y.
    side = np.array([0.0, 1.0, 0.0]) - NADIR[1] * NADIR
    cov[:3, :3] = 1e-6 * np.outer(side, side)
    fit = replace(fit, cov_nadir_altitude=cov)
    right = sigma_in_frame(frames[0].view, fit)
    assert right[0, 0] > 50 * right[1, 1]
    assert RHO_RAD > 0


# Viénot, Brettel & Mollon 1999: linear RGB as dichromats see it.
DICHROMATS = {
    "protanope": [[0.11238, 0.88762, 0], [0.11238, 0.88762, 0], [0.00401, -0.00401, 1]],
    "deuteranope": [[0.29275, 0.70725, 0], [0.29275, 0.70725, 0], [-0.02234, 0.02234, 1]],
}


@pytest.mark.parametrize("eyes", DICHROMATS)
def test_colours_for_the_colour_blind(eyes: str) -> None:
    colours = [YELLOW, SKY_BLUE, LIGHT_GREEN, VERMILLION, PURPLE, (255, 255, 255)]
    rgb = (np.array(colours, float)[:, ::-1] / 255) ** 2.2
    seen = np.clip(rgb @ np.array(DICHROMATS[eyes]).T, 0, 1) ** (1 / 2.2)
    lab = cv2.cvtColor(seen[None].astype(np.float32), cv2.COLOR_RGB2LAB)[0]
    for one, other in combinations(lab, 2):
        # Twenty units of CIELAB are seen at a glance.
        assert np.linalg.norm(one - other) > 20
