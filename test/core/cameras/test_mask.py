"""Masks: the clearance they keep, their reduction; the search sees nothing of the craft."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from limb_frames import CAMERA, PLANET, as_frames, clouds, draw, limb_views
from scipy.spatial import cKDTree

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.cameras.mask import Mask
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.search.candidates import (
    canny_candidates,
    space_boundary_candidates,
)
from horizon_sensor_ros.core.mathematics.attitude import angle_rad

NADIR = np.array([0.0, 0.0, 1.0])
ALTITUDE_M = 500e3


@pytest.mark.parametrize(
    ("use", "said"),
    [
        (np.zeros((4, 5)), "nothing to look at"),
        (np.ones(5), "must be"),
        (np.ones((0, 5)), "must be"),
    ],
)
def test_what_is_no_mask_is_refused(use: np.ndarray, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Mask(use)


def test_a_mask_of_another_size_than_the_camera_is_refused() -> None:
    with pytest.raises(ValueError, match=r"20 x 10.*640 x 480"):
        CameraView("camera_1", CAMERA, np.eye(3), Mask(np.ones((10, 20))))


def test_a_place_that_is_not_known_keeps_no_distance() -> None:
    use = np.ones((8, 10))
    use[:, :2] = 0
    px = np.array([[7.0, 4.0], [np.nan, 4.0], [7.0, np.nan], [np.inf, 4.0], [0.0, 4.0]])
    for mask in (Mask(use), Mask(np.ones((8, 10)))):
        whole = mask.use.all()
        assert mask.clear(px, 3.0).tolist() == [True, False, False, True, whole]


@given(st.integers(0, 2**32 - 1), st.integers(1, 5))
def test_clearance_and_reduction_against_brute_force(seed: int, factor: int) -> None:
    rng = np.random.default_rng(seed)
    use = rng.uniform(size=tuple(rng.integers(5, 40, 2))) > 0.05
    use[0, 0], use[-1, -1] = True, False
    mask = Mask(use)
    v, u = np.nonzero(~use)
    px = rng.uniform(0, [use.shape[1] - 1, use.shape[0] - 1], (50, 2))
    nearest, _ = cKDTree(np.stack([u, v], axis=1)).query(np.rint(px))
    for distance in (0.5, 3.0, 8.0):
        sure = np.abs(nearest - distance) > 1e-3
        np.testing.assert_array_equal(mask.clear(px, distance)[sure], (nearest > distance)[sure])
    reduced = mask.reduced(factor)
    for row, column in np.ndindex(reduced.shape):
        block = use[row * factor : (row + 1) * factor, column * factor : (column + 1) * factor]
        assert reduced[row, column] == block.all()


def test_a_mask_that_hides_nothing_is_clear_everywhere() -> None:
    mask = Mask(np.ones((10, 20)))
    assert mask.clear(np.array([[0.0, 0.0], [19.0, 9.0], [-5.0, 50.0]]), 1e6).all()


def craft_across_the_limb() -> tuple[np.ndarray, np.ndarray]:
    """Where the image may be used, and where a structure of the craft is: a bar and a plate."""
    y, x = np.mgrid[:480, :640]
    craft = (np.abs(x - 0.4 * y - 150) < 25) | ((x > 480) & (y < 260))
    return ~craft, craft


@pytest.mark.parametrize("level", [0, 90, 255])
def test_the_craft_in_the_frame_is_not_seen(level: int) -> None:
    views = limb_views(ALTITUDE_M)
    (drawn,) = draw(views, ALTITUDE_M, clouds(3))
    use, craft = craft_across_the_limb()
    rng = np.random.default_rng(level)
    image = drawn.image.copy()
    # As patterned as structure is: bright, dark and edges all over.
    image[craft] = np.clip(level + rng.choice([-80, 0, 80], craft.sum()), 0, 255)
    other = image.copy()
    other[craft] = rng.integers(0, 256, craft.sum())
    view = CameraView("camera_1", CAMERA, views[0].rot_base_from_cam, Mask(use))
    fixes = [HorizonSensor().process([Frame(view, gray)]) for gray in (image, other)]
    assert fixes[0].ok, fixes[0].reason
    clean = HorizonSensor().process(as_frames(views, (drawn,)))
    off = angle_rad(fixes[0].fit.nadir_base, clean.fit.nadir_base)
    assert np.degrees(off) < 0.03
    assert abs(fixes[0].fit.altitude_m - clean.fit.altitude_m) < 2e3
    # What is masked makes no difference at all.
    np.testing.assert_array_equal(fixes[0].fit.nadir_base, fixes[1].fit.nadir_base)
    limb = fixes[0].limbs[0]
    assert view.mask is not None
    assert view.mask.clear(limb.px, 5.0).all()
    found = space_boundary_candidates(image, mask=view.mask)
    assert len(found) > 20
    assert view.mask.clear(found.px, 3.0).all()


def test_a_mask_away_from_the_limb_changes_nothing_of_the_fit() -> None:
    views = limb_views(ALTITUDE_M)
    (frame,) = as_frames(views, draw(views, ALTITUDE_M))
    use = np.ones((480, 640))
    use[440:, 600:] = 0
    masked = CameraView("camera_1", CAMERA, views[0].rot_base_from_cam, Mask(use))
    plain = HorizonSensor().process([frame])
    with_mask = HorizonSensor().process([Frame(masked, frame.gray)])
    np.testing.assert_allclose(with_mask.fit.nadir_base, plain.fit.nadir_base, atol=2e-6)


def test_a_limb_behind_the_craft_gives_no_fix() -> None:
    views = limb_views(ALTITUDE_M)
    (drawn,) = draw(views, ALTITUDE_M)
    near = np.zeros((480, 640), bool)
    x, y = np.rint(drawn.truth.limb.px).astype(int).T
    near[np.clip(y, 0, 479), np.clip(x, 0, 639)] = True
    y, x = np.nonzero(near)
    grid = np.stack(np.meshgrid(np.arange(640), np.arange(480)), axis=-1)
    far = cKDTree(np.stack([x, y], axis=1)).query(grid.reshape(-1, 2))[0].reshape(480, 640)
    view = CameraView("camera_1", CAMERA, views[0].rot_base_from_cam, Mask(far > 30))
    fix = HorizonSensor().process([Frame(view, drawn.image)])
    assert not fix.ok
    assert fix.reason


def test_canny_limbs_keep_away_too() -> None:
    views = limb_views(ALTITUDE_M)
    (drawn,) = draw(views, ALTITUDE_M)
    use, craft = craft_across_the_limb()
    image = np.where(craft, np.uint8(120), drawn.image)
    view = CameraView("camera_1", CAMERA, views[0].rot_base_from_cam, Mask(use))
    fix = HorizonSensor(HorizonConfig(limb="canny")).process([Frame(view, image)])
    assert fix.ok, fix.reason
    assert len(fix.limbs[0].px) < len(canny_candidates(image))
    assert use[tuple(fix.limbs[0].px.astype(int).T[::-1])].all()
    assert np.degrees(angle_rad(fix.fit.nadir_base, NADIR)) < 0.3
    assert PLANET.rho_from_altitude(fix.fit.altitude_m) == pytest.approx(fix.fit.rho_rad)
