"""How fast the craft turns, by a gyro: what is claimed of its rate."""

from __future__ import annotations

import numpy as np
import pytest

from horizon_sensor_ros.core.aiding import Aiding
from horizon_sensor_ros.core.motion.turn_rate import rate_by_gyro, surely_turns

RATE = np.array([0.02, -0.01, 0.03])


def test_without_a_gyro_there_is_no_rate() -> None:
    assert rate_by_gyro(Aiding()) is None


def test_what_the_rate_may_have_changed_by_since_the_gyro_told_it_is_claimed_too() -> None:
    """Two independent errors, of 0.1 and 0.24 deg/s: 5, 12, 13."""
    steady = rate_by_gyro(Aiding(rate_base_rad_s=RATE))
    changing = rate_by_gyro(Aiding(rate_base_rad_s=RATE, rate_spread_rad_s=np.radians(0.24)))
    assert steady is not None
    assert changing is not None
    np.testing.assert_array_equal(steady.rate_base_rad_s, RATE)
    np.testing.assert_array_equal(changing.rate_base_rad_s, RATE)
    assert np.degrees(steady.sigma_rad_s) == pytest.approx(0.10)
    assert np.degrees(changing.sigma_rad_s) == pytest.approx(0.26)


def test_a_rate_is_one_from_three_sigma_on() -> None:
    assert not surely_turns(np.radians([0.2, 0.2, 0.0]))
    assert surely_turns(np.radians([0.2, 0.2, 0.2]))
