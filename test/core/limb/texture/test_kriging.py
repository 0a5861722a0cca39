"""Kriged edges: against analytic edges, and beside texture drawn by other means."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d
from scipy.special import ndtr

from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.edge.places import place_edges
from horizon_sensor_ros.core.limb.profiles import ProfileGrid, pixel_phase, sample_profiles
from horizon_sensor_ros.core.limb.texture.fitted_limb import fitted_limb
from horizon_sensor_ros.core.limb.texture.kriging import krige_edges
from horizon_sensor_ros.core.limb.texture.stretches import Stretches
from horizon_sensor_ros.core.limb_curve import LimbCurve

GRID = ProfileGrid(-7.0, 15, 1.0, 0.25)
PSF_PX, LENGTH_PX, PX_OVER_RADIUS = 0.757, 16.0, 1e-3


def stretches_of(
    profiles: np.ndarray,
    noise: float,
    psf_px: float = PSF_PX,
    px_over_radius: float = PX_OVER_RADIUS,
) -> Stretches:
    along = np.linspace(-0.4, 0.4, len(profiles))
    base = np.column_stack([np.sin(along), np.cos(along), np.ones(len(profiles))])
    return Stretches(
        profiles, GRID.d_px, noise, psf_px, LENGTH_PX, px_over_radius, base, np.zeros(len(base))
    )


def clean(offset_px: np.ndarray, step: np.ndarray, psf_px: float = PSF_PX) -> np.ndarray:
    return 5.0 + step[:, None] * ndtr((offset_px[:, None] - GRID.d_px) / psf_px)


def textured(
    rng: np.random.Generator,
    num: int,
    wavelengths: tuple[float, float] = (0.03, 0.3),
    strengths: tuple[float, float] = (1.0, 14.0),
    px_over_radius: float = PX_OVER_RADIUS,
) -> np.ndarray:
    """Mean profiles beside a band of waves over the ground, each ray's ground distance its own.

    strengths : along the first half of the limb, and along the second. wavelengths : planet radii.
    """
    fine = np.arange(-12.0, 12.0, 0.05) + 0.025
    pixel = np.arange(num * 16)
    inward = np.sqrt(2.0 * px_over_radius * np.maximum(-fine, 0.0))
    aside = pixel * px_over_radius
    field = np.zeros((len(pixel), len(fine)))
    for wavelength in np.exp(rng.uniform(*np.log(wavelengths), 40)):
        turn, phase = rng.uniform(0.0, 2.0 * np.pi, 2)
        k = 2.0 * np.pi / wavelength
        angle = k * (np.cos(turn) * inward[None, :] + np.sin(turn) * aside[:, None]) + phase
        field += (wavelength / wavelengths[1]) ** 0.7 * np.sin(angle)
    strength = np.where(pixel < len(pixel) / 2, *strengths)
    light = (150.0 + strength[:, None] * field) * (fine < 0.0)
    mean = light.reshape(num, 16, -1).mean(axis=1)
    blurred = gaussian_filter1d(mean, PSF_PX / 0.05, axis=1)
    return np.array([np.interp(GRID.d_px, fine, row) for row in blurred])


@given(
    shift=st.floats(-0.08, 0.08),
    tilt=st.floats(-0.02, 0.02),
    psf_px=st.floats(0.6, 1.1),
    level=st.floats(60.0, 180.0),
    changes=st.lists(st.floats(-0.1, 0.1), min_size=12, max_size=30),
)
def test_clean_edges_lie_where_they_are(
    shift: float, tilt: float, psf_px: float, level: float, changes: list[float]
) -> None:
    levels = level * (1.0 + np.array(changes))
    num = len(levels)
    offset = shift + tilt * np.linspace(-1.0, 1.0, num)
    noise = 0.5
    stretches = stretches_of(clean(offset, levels, psf_px), noise, psf_px)
    found = krige_edges(stretches, np.ones(num, dtype=bool), np.zeros(num))
    assert np.abs(found.offset_px - offset).max() < 0.006
    np.testing.assert_allclose(found.step, levels, rtol=0.02)
    assert np.all(found.misfit < 0.1)
    assert np.abs(stretches.base @ found.limb - offset).max() < 0.004


def test_sigmas_of_clean_edges() -> None:
    rng = np.random.default_rng(3)
    noise, step, num = 0.6, np.full(2000, 120.0), 2000
    profiles = clean(np.zeros(num), step) + noise * rng.standard_normal((num, 15))
    found = krige_edges(stretches_of(profiles, noise), np.ones(num, dtype=bool), np.zeros(num))
    # The bound for a known level: the square root of 2 sqrt(pi) w, over step and noise.
    bound = noise / 120.0 * np.sqrt(2.0 * np.sqrt(np.pi) * PSF_PX)
    assert found.offset_px.std() < 1.25 * bound
    assert np.mean((found.offset_px / found.sigma_px) ** 2) == pytest.approx(1.0, abs=0.15)
    assert found.shared.coherent_px < 0.3 * bound


def test_a_blur_that_is_not_quite_known_is_found() -> None:
    num = 40
    profiles = clean(np.full(num, 0.05), np.full(num, 150.0), psf_px=0.74)
    stretches = stretches_of(profiles, 0.5, psf_px=0.77)
    found = krige_edges(stretches, np.ones(num, dtype=bool), np.zeros(num))
    assert np.abs(found.offset_px - 0.05).max() < 0.004
    assert np.all(found.misfit < 1.0)


def test_texture_moves_edges_less_and_is_seen_where_it_is() -> None:
    rng = np.random.default_rng(8)
    num, noise = 40, 1.0
    errors: dict[str, list[np.ndarray]] = {"kriged": [], "alone": []}
    chi2, ratio = [], []
    for _ in range(25):
        profiles = textured(rng, num) + noise * rng.standard_normal((num, 15))
        found = krige_edges(stretches_of(profiles, noise), np.ones(num, dtype=bool), np.zeros(num))
        errors["kriged"].append(found.offset_px)
        errors["alone"].append(place_edges(profiles, noise, EdgeLook(PSF_PX, 0.0), GRID).offset_px)
        chi2.append(np.mean((found.offset_px / found.sigma_px) ** 2))
        calm, strong = np.median(found.sigma_px[:18]), np.median(found.sigma_px[22:])
        ratio.append(strong / calm)
    kriged, alone = (np.sqrt(np.mean(np.square(errors[name]))) for name in ("kriged", "alone"))
    assert kriged < 0.9 * alone
    assert 0.5 < np.mean(chi2) < 2.0
    assert np.median(ratio) > 2.0


@pytest.mark.slow
@pytest.mark.parametrize("strength", [4.0, 16.0])
def test_error_that_smooth_ground_gives_whole_stretches_is_claimed(strength: float) -> None:
    """Waves of half a radius and more: they bend the limb for a long way, not edge by edge."""
    rng = np.random.default_rng(4)
    num, noise, scale = 48, 1.0, 2e-3
    squares, claimed, all_squares, all_claimed = [], [], [], []
    for _ in range(30):
        profiles = textured(rng, num, (0.5, 2.0), (strength, strength), scale)
        profiles += noise * rng.standard_normal(profiles.shape)
        stretches = stretches_of(profiles, noise, px_over_radius=scale)
        found = krige_edges(stretches, np.ones(num, dtype=bool), np.zeros(num))
        for offset, sigma in zip(
            np.split(found.offset_px, 6), np.split(found.sigma_px, 6), strict=True
        ):
            squares.append(np.average(offset, weights=sigma**-2.0) ** 2)
            claimed.append(found.shared.coherent_px**2 + 1.0 / np.sum(sigma**-2.0))
        assert found.shared.shift_px <= found.shared.coherent_px
        all_squares.append(np.average(found.offset_px, weights=found.sigma_px**-2.0) ** 2)
        all_claimed.append(
            found.shared.shift_px**2
            + found.shared.coherent_px**2 / 6.0
            + 1.0 / np.sum(found.sigma_px**-2.0)
        )
    assert 0.5 < np.mean(squares) / np.mean(claimed) < 2.0
    assert 0.3 < np.mean(all_squares) / np.mean(all_claimed) < 2.0


def test_stretches_without_an_edge_tell_nothing() -> None:
    rng = np.random.default_rng(5)
    num = 30
    good = np.ones(num, dtype=bool)
    good[[0, 7, 8, 20, 29]] = False
    profiles = clean(np.full(num, 0.03), np.full(num, 100.0))
    profiles += 0.5 * rng.standard_normal(profiles.shape)
    spoiled = profiles.copy()
    spoiled[~good] = rng.uniform(0.0, 255.0, (5, 15))
    one, other = (
        krige_edges(stretches_of(p, 0.5), good, np.zeros(num)) for p in (profiles, spoiled)
    )
    np.testing.assert_allclose(one.offset_px[good], other.offset_px[good], atol=1e-9)
    np.testing.assert_allclose(one.sigma_px[good], other.sigma_px[good], rtol=1e-9)
    assert np.abs(other.offset_px[good] - 0.03).max() < 0.03


def test_what_the_raster_does_is_told_by_the_phases_and_taken_out() -> None:
    rng = np.random.default_rng(6)
    num, noise = 40, 0.5
    phase = np.zeros(num, dtype=complex)
    phase[8:20] = np.exp(1j * rng.uniform(0.0, 2.0 * np.pi, 12))
    error = 0.02 * phase.imag
    profiles = clean(error, np.full(num, 150.0)) + noise * rng.standard_normal((num, 15))
    found = krige_edges(stretches_of(profiles, noise), np.ones(num, dtype=bool), phase)
    left = found.offset_px[8:20]
    assert np.sqrt(np.mean(np.square(left))) < 0.5 * np.sqrt(np.mean(np.square(error[8:20])))
    assert np.mean(np.square(left / found.sigma_px[8:20])) < 2.0
    # Normals that point the other way see the same pixels, and the error with the other sign.
    turned = replace(stretches_of(profiles, noise), base=-stretches_of(profiles, noise).base)
    mirrored = krige_edges(turned, np.ones(num, dtype=bool), phase.conj())
    np.testing.assert_allclose(mirrored.offset_px, found.offset_px, atol=1e-9)


def test_stretches_along_one_row_count_as_one() -> None:
    """Where all have the raster's error alike, nothing tells it from the limb's own place."""
    num = 30
    profiles = clean(np.full(num, 0.015), np.full(num, 100.0))
    good = np.ones(num, dtype=bool)
    free = krige_edges(stretches_of(profiles, 0.5), good, np.zeros(num))
    alike = krige_edges(stretches_of(profiles, 0.5), good, np.full(num, 1j))
    together = [np.sqrt(1.0 / np.sum(found.sigma_px**-2.0)) for found in (free, alike)]
    assert together[0] < 0.002
    assert 0.01 < together[1] < 0.02
    assert np.abs(alike.offset_px).max() < 0.02


def test_limb_is_fitted_without_edges_that_lie_far_off() -> None:
    stretches = stretches_of(clean(np.zeros(30), np.full(30, 100.0)), 1.0)
    truth = np.array([0.3, -0.2, 0.1])
    place = stretches.base @ truth
    place += 0.001 * np.random.default_rng(1).standard_normal(30)
    place[4] += 2.0
    limb = fitted_limb(stretches.base, place, np.full(30, 0.01))
    assert np.abs(stretches.base @ (limb - truth)).max() < 0.01


@pytest.mark.parametrize("row", [20.013, 20.25, 20.49, 20.74])
def test_rounding_of_positions_along_a_row_is_put_back(row: float) -> None:
    """An edge along the rows: an exact blurred one, integrated over the pixels."""
    y = np.arange(40.0)
    z = (np.stack([y + 0.5, y - 0.5]) - row) / 0.7
    integral = 0.7 * (z * ndtr(z) + np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi))
    image = np.repeat((5.0 + 195.0 * (integral[0] - integral[1]))[:, None], 300, axis=1)
    px = np.column_stack([np.arange(10.0, 290.0), np.full(280, row)])
    curve = LimbCurve(px, np.tile([0.0, -1.0], (280, 1)), spacing_px=1.0)
    profiles, valid = sample_profiles(image.astype(np.float32), curve, GRID.d_px)
    phase = pixel_phase(curve)
    assert valid.all()
    np.testing.assert_allclose(np.hypot(*phase[:, 1:].mean(axis=0)), 1.0, atol=1e-6)
    means = profiles.reshape(14, 20, -1).mean(axis=1)
    found = krige_edges(stretches_of(means, 0.5), np.ones(14, dtype=bool), np.zeros(14))
    assert np.abs(found.offset_px + phase[0, 0]).max() < 0.005
    assert abs(phase[0, 0]) <= 1.0 / 64.0 + 1e-6


def test_an_odd_edge_lets_the_edges_beside_it_be_less_sure() -> None:
    """A cloud's end that no model follows may reach, unseen, into what is seen beside it."""
    num = 16
    rng = np.random.default_rng(4)
    profiles = clean(np.zeros(num), np.full(num, 60.0)) + 0.3 * rng.standard_normal((num, 15))
    profiles[-2:] += 80.0 * np.exp(-0.5 * ((GRID.d_px + 2.0) / 1.2) ** 2)
    good = np.arange(num) < num - 2
    silent = krige_edges(stretches_of(profiles, 0.3), good, np.zeros(num))
    told = krige_edges(stretches_of(profiles, 0.3), good, np.zeros(num), ~good)
    more = told.sigma_px[good] / silent.sigma_px[good]
    assert more[-1] > 4.0
    assert more[-2] > 1.5
    # Far from there nothing changes, nor where no edge is odd.
    np.testing.assert_allclose(told.sigma_px[:4], silent.sigma_px[:4], rtol=0.1)
    none = krige_edges(stretches_of(profiles, 0.3), good, np.zeros(num), ~good & good)
    np.testing.assert_array_equal(none.sigma_px, silent.sigma_px)
