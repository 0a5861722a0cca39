"""Towards the terminator: whether a limb ends there, the part that is lit, and by how much."""

from __future__ import annotations

import numpy as np
import pytest

from horizon_sensor_ros.core.limb.air import FURTHER
from horizon_sensor_ros.core.limb.glow.brightness import further_powers
from horizon_sensor_ros.core.limb.glow.twilight import (
    darker_end,
    lit_part,
    lit_shares,
    taken_for_limb,
)


@pytest.mark.parametrize("turned", [False, True])
def test_the_lit_part_ends_where_an_eighth_of_the_glow_is_left(turned: bool) -> None:
    glow = np.exp(-np.linspace(0.0, 4.0, 41))
    glow[30] = 9.0  # a star
    found = lit_part(glow[::-1] if turned else glow)
    assert found is not None
    first, last = (1.0 - found[1], 1.0 - found[0]) if turned else found
    assert first == 0.0
    assert last == pytest.approx(21 / 41, abs=0.03)


def test_all_of_an_evenly_lit_limb_is_lit_and_nothing_of_a_dark_one() -> None:
    assert lit_part(np.full(20, 30.0)) == (0.0, 1.0)
    assert lit_part(np.full(20, -0.1)) is None


@pytest.mark.parametrize("turned", [False, True])
def test_the_darker_end_of_a_limb_is_told_beside_clouds(turned: bool) -> None:
    lit = np.clip(1.5 - 2.0 * np.linspace(0.0, 1.0, 25), 0.0, 1.0)
    lit[:4] *= (0.6, 1.0, 0.3, 0.8)
    dark, brightest = darker_end(100.0 * (lit[::-1] if turned else lit))
    assert dark == 0.0
    assert brightest == pytest.approx(100.0, abs=5.0)


def test_further_powers_are_none_of_the_lower_ones() -> None:
    along, weight = np.polynomial.legendre.leggauss(12)
    further = further_powers(along, FURTHER)
    lower = np.vander(along, 3, increasing=True)
    assert np.abs(lower.T @ (weight[:, None] * further)).max() < 1e-12
    assert further_powers(along, 0).shape == (12, 0)


def test_ground_is_lit_as_its_levels_are_but_for_texture() -> None:
    along = np.linspace(-1.0, 1.0, 25)
    lit = 0.55 + 0.45 * along
    texture = 1.0 + 0.1 * np.sin(40.0 * along)
    assert np.abs(lit_shares(along, 80.0 * lit * texture) - lit).max() < 0.1
    assert lit_shares(along, np.full(25, -1.0)).tolist() == [1.0] * 25


@pytest.mark.parametrize(
    ("evened", "share", "misfit"), [(0.0, 0.4, 1.2), (0.5, 0.5, 1.2), (0.5, 0.4, 0.4)]
)
def test_a_limb_is_none_of_fading_glow_where_anything_speaks_for_it(
    evened: float, share: float, misfit: float
) -> None:
    """The same glow as at first sight, all of the air in front of the ground, or a good fit."""
    assert taken_for_limb(0.5, 0.4, 1.2)
    assert not taken_for_limb(evened, share, misfit)
