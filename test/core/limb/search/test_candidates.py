"""Candidates against the true limb of drawn frames, and against frames without one."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from limb_frames import (
    as_frames,
    clouds,
    distance_px,
    draw,
    limb_views,
    share_near_limb,
    unlike_any_limb,
)
from scipy.spatial import cKDTree

from horizon_sensor_ros.core.limb.search.candidates import (
    LimbCandidates,
    candidates_in,
    canny_candidates,
    space_boundary_candidates,
)
from horizon_sensor_ros.core.limb.search.working_image import (
    WORKING_SIZE_PX,
    WorkingImage,
    reduce_image,
    space_level_and_noise,
)
from horizon_sensor_ros.sim.earth_camera import SimFrame
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging, Occluder
from horizon_sensor_ros.sim.hard_scenes import hard_scene, hard_scenes

NEAR_PX = 4.0  # two grid steps of a 640 pixel image


@pytest.fixture(scope="module")
def clouded() -> list[SimFrame]:
    """Eight frames of clouded planets."""
    return [frame for scene in hard_scenes(4, 11, ("clouds",)) for frame in scene.frames]


@pytest.fixture(scope="module")
def uniform() -> SimFrame:
    return draw(limb_views(500e3), 500e3)[0]


# ---------------------------------------------------------------- on the limb, not on clouds


def test_most_candidates_lie_on_the_limb_where_most_canny_edges_are_clouds(
    clouded: list[SimFrame],
) -> None:
    ours, cannys = [], []
    for frame in clouded:
        limb = frame.truth.limb
        ours.append(share_near_limb(limb, space_boundary_candidates(frame.image).px, NEAR_PX))
        cannys.append(share_near_limb(limb, canny_candidates(frame.image).px, NEAR_PX))
    # found in this sample: 0.47 to 0.81, mean 0.67, where Canny has 0.15 to 0.33, mean 0.21
    assert np.mean(ours) > 0.58
    assert min(ours) > 0.4
    assert np.mean(cannys) < 0.3
    assert max(cannys) < 0.42
    assert np.all(np.array(ours) > 1.2 * np.array(cannys))


def test_candidates_cover_the_limb(clouded: list[SimFrame]) -> None:
    """Wherever the limb stands out there is a candidate nearby."""
    for frame in clouded:
        limb = frame.truth.limb
        clear = limb.visible(40.0) & (limb.px > 16).all(axis=1)
        clear &= (limb.px < np.array([640, 480]) - 16).all(axis=1)
        distance, _ = cKDTree(space_boundary_candidates(frame.image).px).query(limb.px[clear])
        assert np.mean(distance < 10.0) > 0.8


def test_uniform_planet_gives_nothing_but_limb(uniform: SimFrame) -> None:
    limb = uniform.truth.limb
    found = space_boundary_candidates(uniform.image)
    assert len(found) > 150
    assert share_near_limb(limb, found.px, 3.0) == 1.0
    _, nearest = cKDTree(limb.px).query(found.px)
    along = np.sum(found.normal_px * limb.normal_px[nearest], axis=1)
    assert along.min() > 0.97
    np.testing.assert_allclose(np.linalg.norm(found.normal_px, axis=1), 1.0, atol=1e-6)
    assert found.pitch_px == 2.0
    assert WorkingImage.of(uniform.image).space_level == pytest.approx(4.0, abs=1.0)
    # all of the step, save the blur
    assert np.median(found.contrast) == pytest.approx(195.0, rel=0.2)


def test_candidates_lie_on_the_limb_to_a_part_of_a_pixel(uniform: SimFrame) -> None:
    found = space_boundary_candidates(uniform.image)
    assert found.pitch_px == 2.0
    px = found.px + found.beyond_px[:, None] * found.normal_px
    off = distance_px(uniform.truth.limb, px)
    before = distance_px(uniform.truth.limb, found.px)
    assert np.median(np.abs(off)) < 0.12 < np.median(np.abs(before))
    assert abs(np.median(off)) < 0.03


def test_hardly_any_candidate_looks_inwards(clouded: list[SimFrame]) -> None:
    for frame in clouded:
        found, limb = space_boundary_candidates(frame.image), frame.truth.limb
        distance, nearest = cKDTree(limb.px).query(found.px)
        near = distance < NEAR_PX
        along = np.sum(found.normal_px * limb.normal_px[nearest], axis=1)[near]
        assert np.mean(along > 0.7) > 0.95


def test_a_part_of_the_craft_does_not_hide_the_rest() -> None:
    bar = Occluder(((300.0, -9.0), (360.0, -9.0), (400.0, 489.0), (340.0, 489.0)), 90.0)
    views = limb_views(600e3, roll_rad=0.1)
    frame = draw(views, 600e3, clouds(3), Imaging(noise_dn=1.5, occluders=(bar,)))[0]
    limb = frame.truth.limb
    found = space_boundary_candidates(frame.image)
    distance, _ = cKDTree(found.px).query(limb.px[limb.visible(30.0)])
    assert np.mean(distance < 10.0) > 0.7


def test_stars_and_hot_pixels_stay_a_minority() -> None:
    views = limb_views(500e3, above_rad=0.1)
    scene = EarthScene(star_count=4000, star_seed=2)
    frame = draw(views, 500e3, scene, Imaging(noise_dn=1.0, hot_pixels=150))[0]
    found = space_boundary_candidates(frame.image)
    assert share_near_limb(frame.truth.limb, found.px, NEAR_PX) > 0.6


# ---------------------------------------------------------------- gray levels


@pytest.mark.parametrize("factor", [16, 257])
def test_gray_levels_of_16_bits_give_the_same_candidates(
    factor: int, clouded: list[SimFrame]
) -> None:
    """Up to the rounding of the 8-bit image when it is reduced."""
    for frame in clouded[:4]:
        bytes_working = WorkingImage.of(frame.image)
        words_working = WorkingImage.of(frame.image.astype(np.uint16) * np.uint16(factor))
        few = candidates_in(bytes_working, max_candidates=100000)
        wide = candidates_in(words_working, max_candidates=100000)
        assert len(wide) == pytest.approx(len(few), rel=0.03)
        distance, _ = cKDTree(few.px).query(wide.px)
        assert np.mean(distance < 0.1) > 0.93
        # the reduced 8-bit image is rounded, and with it its levels
        level, noise = words_working.space_level / factor, words_working.noise / factor
        assert level == pytest.approx(bytes_working.space_level, abs=1.0)
        assert noise == pytest.approx(bytes_working.noise, abs=0.5)


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
def test_canny_sees_the_same_in_16_bits(clouded: list[SimFrame], bits: int) -> None:
    """However many of them the camera uses."""
    image = clouded[0].image
    assert image.max() > 127
    deep = np.rint(image * ((2.0**bits - 1.0) / 255.0)).astype(np.uint16)
    eight, sixteen = canny_candidates(image), canny_candidates(deep)
    np.testing.assert_array_equal(eight.px, sixteen.px)
    np.testing.assert_array_equal(eight.normal_px, sixteen.normal_px)


def test_canny_edges_of_a_step() -> None:
    image = np.zeros((60, 80), np.uint8)
    image[:, 40:] = 200
    found = canny_candidates(image)
    assert np.all(np.abs(found.px[:, 0] - 39.5) <= 0.5)
    assert np.unique(found.px[:, 1]).size > 50
    np.testing.assert_allclose(found.normal_px, np.tile([-1.0, 0.0], (len(found), 1)), atol=1e-12)
    # OpenCV's edges of the same smoothed image
    edges = cv2.Canny(cv2.GaussianBlur(image, (5, 5), 1.0), 50, 150, L2gradient=True)
    assert np.count_nonzero(edges) == len(found)


# ---------------------------------------------------------------- the reduced image


def test_reduced_image_is_the_blocks_mean() -> None:
    image = np.random.default_rng(0).integers(0, 65535, (970, 1290)).astype(np.uint16)
    small, factor = reduce_image(image)
    assert small.dtype == np.float32
    assert factor == 4
    assert max(small.shape) <= 1.25 * WORKING_SIZE_PX + 1
    rows, cols = 970 // 4, 1290 // 4
    blocks = image[: rows * 4, : cols * 4].reshape(rows, 4, cols, 4).mean(axis=(1, 3))
    np.testing.assert_allclose(small, blocks, atol=1.0)


@pytest.mark.parametrize("shape", [(16, 16), (320, 240), (200, 320)])
def test_small_images_are_taken_as_they_are(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(0).integers(0, 255, shape).astype(np.uint8)
    small, factor = reduce_image(image)
    assert factor == 1
    np.testing.assert_array_equal(small, image)


@pytest.mark.parametrize("slope", [0.0, 0.3, 1.0, 3.0])
def test_space_level_is_that_of_space_wherever_the_limb_crosses_the_tiles(slope: float) -> None:
    """Tiles that are half planet have space's median, and must not pass for it."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:240, :320]
    for offset in range(0, 200, 7):
        image = np.where(y < slope * (x - 160) + 20 + offset, 4.0, 200.0)
        image = np.rint(image + rng.normal(0.0, 0.7, image.shape)).astype(np.float32)
        level, noise = space_level_and_noise(image)
        assert level == pytest.approx(4.0, abs=1.0)
        assert noise < 2.0


@pytest.mark.parametrize("sigma", [1.0, 4.0, 20.0])
def test_level_and_noise_of_space_are_those_that_were_drawn(sigma: float) -> None:
    image = np.random.default_rng(2).normal(100.0, sigma, (240, 320)).astype(np.float32)
    image[150:] = 4000.0
    level, noise = space_level_and_noise(image)
    assert level == pytest.approx(100.0, abs=0.5 * sigma)
    assert noise == pytest.approx(sigma, rel=0.25)


# ---------------------------------------------------------------- none, and too many


@pytest.mark.parametrize("name", ["black", "constant", "white", "gradient"])
def test_featureless_frames_have_no_candidates(name: str) -> None:
    for image in (frame := unlike_any_limb()[name], frame.astype(np.uint16) * 257):
        found = space_boundary_candidates(image)
        assert len(found) == 0
        assert found.px.shape == found.normal_px.shape == (0, 2)
        assert len(canny_candidates(image)) == 0


@pytest.mark.parametrize("name", ["random", "faint noise", "checkerboard of 1"])
def test_noise_has_few_candidates(name: str) -> None:
    assert len(space_boundary_candidates(unlike_any_limb()[name])) < 30


def test_candidates_are_thinned_evenly(uniform: SimFrame) -> None:
    every = space_boundary_candidates(uniform.image)
    some = space_boundary_candidates(uniform.image, max_candidates=40)
    assert len(some) == 40
    distance, _ = cKDTree(every.px).query(some.px)
    assert distance.max() == 0.0
    reach, _ = cKDTree(some.px).query(every.px)
    assert reach.max() < 0.1 * np.linalg.norm(np.ptp(every.px, axis=0))


def test_nothing_found_is_empty() -> None:
    assert len(LimbCandidates()) == 0


def test_the_image_is_left_as_it_was(uniform: SimFrame) -> None:
    before = uniform.image.copy()
    space_boundary_candidates(uniform.image)
    canny_candidates(uniform.image)
    np.testing.assert_array_equal(before, uniform.image)
    assert as_frames(limb_views(500e3), (uniform,))[0].gray is uniform.image


@pytest.mark.parametrize("width_px", [1.0, 2.4])
def test_a_streak_is_no_limb(width_px: float) -> None:
    y = np.arange(480)[:, None] - 200.3
    image = np.random.default_rng(0).normal(8.0, 1.0, (480, 640)) + 90.0 * np.exp(
        -0.5 * np.square(y / width_px)
    )
    assert len(space_boundary_candidates(np.clip(image, 0, 255).astype(np.uint8))) < 60


@pytest.mark.parametrize(("index", "seed"), [(77, 9), (317, 2718), (413, 555)])
def test_the_suns_streak_is_no_limb_within_its_glare_either(index: int, seed: int) -> None:
    """Beside the streak it is as bright there as inside a limb."""
    image = hard_scene("sun", index, seed).frames[0].image
    row = np.median(np.nonzero(image == image.max())[0])
    found = space_boundary_candidates(image)
    assert len(found) > 40
    assert np.abs(found.px[:, 1] - row).min() > 12.0
