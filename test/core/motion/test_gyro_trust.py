"""Gyros of which the horizon's motion tells that they are wrong, now and then."""

from __future__ import annotations

import math

import numpy as np
import pytest

from horizon_sensor_ros.core.motion.gyro_trust import GyroTrust
from horizon_sensor_ros.core.motion.turn_rate import GYRO_SIGMA_RAD_S, TurnRate

PERIOD_S = 0.1
NADIR = np.array([0.0, 0.6, 0.8])
ACROSS, ABOUT = np.array([1.0, 0.0, 0.0]), NADIR
TRUE = np.radians([2.0, -1.0, 0.5])


def asked(
    off_deg_s: np.ndarray, sigma_deg_s: float = 0.2, trust: GyroTrust | None = None
) -> list[bool]:
    """What is believed of a gyro, set by set, that is off so far from what fixes tell so well."""
    trust = GyroTrust() if trust is None else trust
    by_fixes = TurnRate(TRUE, math.radians(sigma_deg_s), NADIR)
    return [
        trust.believes(TurnRate(TRUE + off, GYRO_SIGMA_RAD_S), by_fixes, PERIOD_S)
        for off in np.radians(off_deg_s)
    ]


def test_a_right_gyro_is_believed_as_is_what_fixes_do_not_tell() -> None:
    """They tell nothing of a turn about nadir, however fast."""
    rng = np.random.default_rng(0)
    assert all(asked(0.2 * rng.standard_normal((1000, 3))))
    assert all(asked(np.outer(rng.uniform(-100.0, 100.0, 100), ABOUT)))


def test_a_biased_gyro_stays_refused_where_fixes_tell_less() -> None:
    trust = GyroTrust()
    bias = np.tile(3.0 * ACROSS, (50, 1))
    assert all(asked(bias, 2.0, trust))  # nothing tells it yet
    assert not any(asked(bias[:1], 0.2, trust))
    assert not any(asked(bias, 2.0, trust))


@pytest.mark.parametrize("period_s", [4.0, 8.0])
def test_a_gyro_of_the_wrong_sign_is_not_believed_where_a_swing_turns_back(period_s: float) -> None:
    time_s = np.arange(400) * PERIOD_S
    rate_deg_s = 5.0 * np.cos(2.0 * np.pi * time_s / period_s)
    believed = asked(np.outer(-2.0 * rate_deg_s, ACROSS))
    assert not any(believed)


def test_it_is_believed_again_after_ten_seconds_of_being_right() -> None:
    off = np.zeros((150, 3))
    off[10] = 50.0 * ACROSS
    believed = asked(off)
    assert all(believed[:10])
    again = believed.index(True, 10)
    assert not any(believed[10:again])
    assert all(believed[again:])
    assert 10.0 < (again - 10) * PERIOD_S < 10.5


def test_where_no_fixes_tell_anything_for_a_minute_it_is_asked_anew() -> None:
    trust = GyroTrust()
    told = TurnRate(TRUE, GYRO_SIGMA_RAD_S)
    trust.refute()
    believed = [trust.believes(told, None, PERIOD_S) for _ in range(700)]
    assert 59.8 < believed.index(True) * PERIOD_S < 60.3
    trust.refute()
    assert not any(trust.believes(told, None, None) for _ in range(1000))
