"""Limbs smeared by motion: the blur that goes with their direction, and fixes of such frames."""

from __future__ import annotations

from itertools import islice

import cv2
import numpy as np
import pytest
from limb_frames import draw, limb_views
from limb_samples import nadir_nees
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.edge.smear import Causes, blur_along
from horizon_sensor_ros.core.mathematics.attitude import angle_rad
from horizon_sensor_ros.sim.earth_camera import render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.scene_sets import set_m


def smeared(image: np.ndarray, length_px: int, angle_deg: float) -> np.ndarray:
    """The image, moved along a line while it was exposed."""
    reach = length_px + 2
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1))
    turn = np.radians(angle_deg)
    for at in np.linspace(-0.5, 0.5, 200) * length_px:
        x, y = reach + at * np.cos(turn), reach + at * np.sin(turn)
        i, j = int(y), int(x)
        kernel[i : i + 2, j : j + 2] += np.outer([1 - y % 1, y % 1], [1 - x % 1, x % 1])
    blurred = cv2.filter2D(
        image.astype(np.float32), -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE
    )
    return np.rint(blurred).astype(np.uint8)


def test_blur_follows_the_direction_only_where_that_is_sure() -> None:
    angle = np.linspace(0.0, 2.0, 50)
    normal_px = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    truth = 0.2 * np.cos(2.0 * angle) - 0.1 * np.sin(2.0 * angle)
    noise = 0.01 * np.random.default_rng(1).standard_normal(50)
    known = np.full(50, 1e4)
    still = np.zeros(50)
    found = blur_along(Causes.of(normal_px, still, still), truth + noise, known, 0.75)
    lacking = found.lacking_px
    assert np.ptp(lacking) == pytest.approx(np.ptp(truth), rel=0.1)
    np.testing.assert_allclose(lacking - lacking.mean(), truth - truth.mean(), atol=0.02)
    assert found.open_px < 0.02
    # What neighbours say alike, and others otherwise, is texture's.
    texture = 0.2 * np.sign(np.sin(15.0 * angle))
    feigned = blur_along(Causes.of(normal_px, still, still), truth + texture, known, 0.75)
    assert np.ptp(feigned.lacking_px) == 0.0


def _rolled(smear_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Normals (39, 2) along a limb, and its blur by a roll by so much about where it runs up."""
    angle = np.linspace(-0.45, 1.1, 39)
    blur_px = np.sqrt(0.76**2 + smear_px**2 * np.sin(angle) ** 2 / 12.0)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1), blur_px


def test_a_smear_is_told_from_a_lens_that_explains_a_part_of_it() -> None:
    """Whatever a lens may do was taken off first, and of the rest a smear explained too little."""
    normal_px, blur_px = _rolled(1.4)
    cornered = 0.05 + 0.8 * np.square(np.linspace(-0.67, 1.0, 39))
    causes = Causes.of(normal_px, np.zeros(39), cornered)
    noise, known = 0.01 * np.random.default_rng(3).standard_normal(39), np.full(39, 1e4)
    found = blur_along(causes, blur_px - blur_px.mean() + noise, known, float(blur_px.mean()))
    assert np.ptp(found.lacking_px - blur_px) < 0.012
    assert found.corner is None
    of_lens = blur_along(causes, 0.1 * cornered + noise, known, 0.79)
    assert np.ptp(of_lens.lacking_px - 0.1 * cornered) < 0.012
    assert of_lens.corner is not None


def test_a_smear_that_is_not_sure_moves_nothing_and_is_claimed() -> None:
    normal_px, blur_px = _rolled(2.2)
    smear_px = blur_px - blur_px.mean()
    none = np.zeros(39)
    causes = Causes.of(normal_px, none, none)
    found = [
        blur_along(causes, smear_px, np.full(39, sigma_px**-2.0), 0.76)
        for sigma_px in (0.01, 0.06, 0.08, 0.3)
    ]
    assert [np.ptp(each.lacking_px) > 0.0 for each in found] == [True, False, False, False]
    sure, *claimed, nothing = (each.open_px / smear_px.std() for each in found)
    assert sure < 0.1
    assert all(0.2 < share < 1.0 for share in claimed)
    assert nothing == 0.0


def test_what_texture_hides_of_a_smear_stays_open_where_the_blur_is_large() -> None:
    angle = np.linspace(0.0, 1.0, 50)
    normal_px = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    known = np.full(50, 1e4)
    texture = 0.2 * np.sign(np.sin(15.0 * angle))
    still = np.zeros(50)
    small, large = (
        blur_along(Causes.of(normal_px, still, still), texture, known, psf_px).open_px
        for psf_px in (0.75, 1.5)
    )
    assert small == 0.0
    assert large > 0.05
    assert blur_along(Causes.of(normal_px, still, still), 0.0 * texture, known, 1.5).open_px < 0.03


def test_edges_that_tell_nothing_leave_the_blur_as_it_was_assumed() -> None:
    normal_px, nothing = np.tile([0.0, 1.0], (9, 1)), np.zeros(9)
    found = blur_along(
        Causes.of(normal_px, nothing, np.linspace(0.0, 1.0, 9)), nothing + 0.3, nothing, 0.75
    )
    assert (found.lacking_px == 0.0).all()
    assert found.open_px == 0.0


def test_what_the_raster_does_to_the_blur_is_no_smear() -> None:
    """A limb that turns away from the rows: only where it runs with them is its blur another."""
    angle = np.linspace(-0.3, 0.6, 40)
    normal_px = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    raster = np.exp(-np.square(angle / 0.08)) * np.cos(9.0 * angle)
    noise = 0.007 * np.random.default_rng(2).standard_normal(40)
    known = np.full(40, 0.007**-2.0)
    found = blur_along(
        Causes.of(normal_px, raster, 0.0 * raster), 0.08 * raster + noise, known, 0.75
    ).lacking_px
    np.testing.assert_allclose(found, 0.08 * raster, atol=0.012)
    smear = 0.1 * np.cos(2.0 * angle)
    lacking = 0.08 * raster + smear + noise
    found = blur_along(Causes.of(normal_px, raster, 0.0 * raster), lacking, known, 0.75).lacking_px
    off = found - (0.08 * raster + smear)
    assert np.abs(off - off.mean()).max() < 0.012


@pytest.mark.parametrize("angle_deg", [0.0, 35.0])
def test_frames_smeared_by_three_pixels_are_as_far_off_as_claimed(angle_deg: float) -> None:
    """With one blur for all directions sigmas were ten times too small."""
    nees = []
    for seed, altitude_m in enumerate((500e3, 800e3, 1500e3, 4000e3)):
        views = limb_views(altitude_m, azimuths_rad=(0.8 * seed,))
        drawn = draw(views, altitude_m, None, Imaging(noise_dn=2.0), seed)[0]
        fix = HorizonSensor().process([Frame(views[0], smeared(drawn.image, 3, angle_deg))])
        assert fix.ok
        off = np.cross(fix.fit.nadir_base, drawn.truth.nadir_base)
        nees.append(2.0 * off @ off / np.trace(fix.fit.cov_nadir_altitude[:3, :3]))
    assert np.mean(nees) < 6.0


def test_frames_smeared_by_two_pixels_beside_clouds_are_as_far_off_as_claimed() -> None:
    """Where the smear went with a corner of the frame, too, it was a lens's: the mean was 5.4."""
    squares = []
    for seed in range(100, 116):
        case = next(islice(set_m(2, seed), 1, None))
        (view,), (frame,) = case.views, case.frames
        fix = HorizonSensor().process([Frame(view, frame.image)])
        assert fix.ok
        squares.append(nadir_nees(fix.fit, frame.truth.nadir_base))
    assert np.mean(squares) < 2.6


def test_a_smear_that_grows_along_the_limb_does_not_turn_it() -> None:
    """A roll about one end, even ground: kriging took the other end's ramp for texture, and the
    limb was 1.5 deg off, by six sigma.
    """
    (view,) = limb_views(300e3, azimuths_rad=(0.8,))
    drawn = draw((view,), 300e3, None, Imaging(noise_dn=2.0), 5)[0]
    height, width = drawn.image.shape
    image = np.zeros((height, width))
    for share in np.linspace(-0.5, 0.5, 61):
        angle_deg = float(np.degrees(share * 8.0 / width))
        roll = cv2.getRotationMatrix2D((width - 1.0, height / 2.0), angle_deg, 1.0)
        image += cv2.warpAffine(
            drawn.image.astype(np.float32),
            roll,
            (width, height),
            flags=cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REPLICATE,
        )
    noise = np.random.default_rng(5).normal(0.0, 2.0, image.shape)
    gray = np.clip(np.rint(image / 61.0 + noise), 0.0, 255.0).astype(np.uint8)
    fix = HorizonSensor().process([Frame(view, gray)])
    assert fix.ok
    assert nadir_nees(fix.fit, drawn.truth.nadir_base) < 11.8
    assert angle_rad(fix.fit.nadir_base, drawn.truth.nadir_base) < np.radians(0.1)


@pytest.mark.parametrize(("clouds", "moved_px", "roll_deg"), [(False, 5.0, 0.4), (True, 8.0, 0.4)])
def test_a_followed_limb_is_searched_anew_when_the_craft_begins_to_turn(
    clouds: bool, moved_px: float, roll_deg: float
) -> None:
    """The first smeared frame was taken for a sharp one; fixes were off by six sigma and more."""
    (view,) = limb_views(800e3, azimuths_rad=(0.8,))
    texture = {"texture": "clouds", "cloud_contrast": 0.2} if clouds else {}
    scene, rng = EarthScene(**texture), np.random.default_rng(3)
    position = np.array([0.0, 0.0, -(scene.planet.radius_m + 800e3)])
    sensor = HorizonSensor()
    across = moved_px / view.camera.fx
    turn = view.rot_base_from_cam @ np.array([across, 0.0, np.radians(roll_deg)])
    for smear in (0.0, 0.0, 0.0, 1.0):
        rot = Rotation.from_rotvec(0.5 * smear * turn).as_matrix()
        moving = turn if smear else None
        (drawn,) = render_views(
            (view,), rot, position, scene, rng, imaging=Imaging(noise_dn=4.0), turn_base_rad=moving
        )
        fix = sensor.process([Frame(view, drawn.image)])
    assert not sensor.following
    searched = HorizonSensor().process([Frame(view, drawn.image)])
    assert fix.status is searched.status
    np.testing.assert_array_equal(fix.fit.nadir_base, searched.fit.nadir_base)
