"""The limb by the contour of the glow above it: profiles of known limbs, edges off by stretches."""

from __future__ import annotations

import numpy as np
import pytest

from horizon_sensor_ros.core.limb.glow.contour import ContourLimb, contour_limb
from horizon_sensor_ros.core.limb.profiles import EdgePlaces

_D_PX = np.arange(-7.0, 8.0)
_FADING_PX = 2.5
_NUM = 40
_ALONG_PX = 16.0 * np.arange(_NUM)
_U = np.linspace(-1.0, 1.0, _NUM)
_NORMAL = np.tile([0.0, -1.0], (_NUM, 1))


def _profiles(limb_px: np.ndarray, glow: np.ndarray, pitch: np.ndarray) -> np.ndarray:
    """Air that fades exponentially over space at 5, above ground at 120."""
    height = (_D_PX - limb_px[:, None]) * pitch[:, None]
    rng = np.random.default_rng(4)
    above = 5.0 + glow[:, None] * np.exp(-np.maximum(height, 0.0) / _FADING_PX)
    return np.where(height < 0.0, 120.0, above) + rng.normal(0.0, 0.3, height.shape)


def _edges(offset_px: np.ndarray) -> EdgePlaces:
    ones = np.ones(_NUM)
    return EdgePlaces(offset_px, 0.3 * ones, 90.0 * ones, 99.0 * ones, ones, ones < 0)


def _looked(
    limb_px: np.ndarray, found_px: np.ndarray, glow: np.ndarray, pitch: np.ndarray
) -> ContourLimb | None:
    profiles = _profiles(limb_px, glow, pitch)
    return contour_limb(profiles, _D_PX, _edges(found_px), 0.3, _ALONG_PX, _NORMAL, 1e-3 * pitch)


def test_stretches_off_by_texture_do_not_bend_the_limb() -> None:
    limb = 0.4 * _U**2 - 0.2 * _U
    found = limb + np.where(_U < -0.7, -1.6, 0.0) + np.where(_U > 0.8, -0.7, 0.0)
    found += np.random.default_rng(1).normal(0.0, 0.1, _NUM)
    pitch = 1.0 + 0.3 * _U**2  # towards the border a pixel is a smaller angle, or a larger one
    contour = _looked(limb, found, np.full(_NUM, 60.0), pitch)
    assert contour is not None
    assert contour.keep.all()
    bend = np.polyfit(_U, found - limb, 2)[0]
    mended = np.polyfit(_U, contour.offset_px - limb, 2)[0]
    assert bend < -0.8
    assert abs(mended) < 0.5 * abs(bend)
    assert abs(mended) < 3.0 * contour.coherent_px


@pytest.mark.parametrize("slope", [0.0, 0.5])
def test_good_edges_are_kept_where_the_glow_changes_along_the_limb(slope: float) -> None:
    limb = 0.3 * _U
    contour = _looked(limb, limb, 60.0 * np.exp(slope * _U), np.ones(_NUM))
    assert contour is not None
    assert np.abs(contour.offset_px - limb).max() < 0.1
    assert contour.coherent_px < 0.25


def test_a_star_in_the_glow_is_left_out() -> None:
    profiles = _profiles(np.zeros(_NUM), np.full(_NUM, 60.0), np.ones(_NUM))
    profiles[7, 11:13] += 80.0
    contour = contour_limb(
        profiles, _D_PX, _edges(np.zeros(_NUM)), 0.3, _ALONG_PX, _NORMAL, np.full(_NUM, 1e-3)
    )
    assert contour is not None
    assert not contour.keep[7]
    assert np.count_nonzero(contour.keep) == _NUM - 1
    moved = contour.places(_edges(np.zeros(_NUM)))
    assert len(moved.offset_px) == _NUM - 1
    assert np.abs(moved.offset_px).max() < 0.1


def test_no_contour_without_glow_or_around_a_whole_disc() -> None:
    flat, ones = np.zeros(_NUM), np.ones(_NUM)
    dark = np.full((_NUM, len(_D_PX)), 5.0)
    arguments = (_D_PX, _edges(flat), 0.3, _ALONG_PX)
    assert contour_limb(dark, *arguments, _NORMAL, 1e-3 * ones) is None
    bright = _profiles(flat, 60.0 * ones, ones)
    half = np.stack([np.cos(1.5 * _U), np.sin(1.5 * _U)], axis=1)
    assert contour_limb(bright, *arguments, half, 1e-3 * ones) is None
