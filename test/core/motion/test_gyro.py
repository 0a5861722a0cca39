"""Integrated rates against closed forms and an ODE solver."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.motion.gyro import RateHistory

S = 1_000_000_000
START = 1_700_000_000 * S
GAP = S // 5


def history(stamps: list[int], rates: np.ndarray, gap: int = GAP) -> RateHistory:
    out = RateHistory(gap)
    for stamp, rate in zip(stamps, rates, strict=True):
        assert out.add(stamp, rate)
    return out


def every(step: int, until: int) -> list[int]:
    return [START + t for t in range(0, until + 1, step)]


@given(
    st.tuples(*[st.floats(-3, 3)] * 3), st.integers(0, S // 2), st.integers(0, S // 2),
    st.integers(5_000_000, GAP),
)  # fmt: skip
def test_a_steady_rate_is_one_rotation(
    rate: tuple[float, ...], start: int, length: int, step: int
) -> None:
    stamps = every(step, S)
    rot = history(stamps, np.tile(rate, (len(stamps), 1))).rotation(
        START + start, START + start + length
    )
    # The frame turns by +rate, so a vector that stands still turns by -rate in it.
    want = Rotation.from_rotvec(-np.array(rate) * length / S).as_matrix()
    np.testing.assert_allclose(rot, want, atol=1e-9)


def test_a_changing_rate_against_an_ode_solver() -> None:
    def rate(t: float) -> np.ndarray:
        return np.array([0.3 * np.sin(7 * t), 0.2 + t, -0.4 * np.cos(3 * t)])

    def turned(t: float, v: np.ndarray) -> np.ndarray:
        return -np.cross(rate(t), v.reshape(3, 3).T).T.ravel()

    stamps = every(5_000_000, S)
    found = history(stamps, np.array([rate((s - START) / S) for s in stamps])).rotation(
        START + 123_456_789, START + 876_543_210
    )
    solved = solve_ivp(turned, (0.123456789, 0.87654321), np.eye(3).ravel(), rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(found, solved.y[:, -1].reshape(3, 3), atol=3e-5)


def test_rotations_follow_each_other() -> None:
    rng = np.random.default_rng(1)
    stamps = every(10_000_000, S)
    rates = history(stamps, rng.normal(0, 1, (len(stamps), 3)))
    a, b, c = (START + s for s in (100_000_000, 400_000_000, 900_000_000))
    first, second, both = rates.rotation(a, b), rates.rotation(b, c), rates.rotation(a, c)
    assert first is not None
    assert second is not None
    np.testing.assert_allclose(second @ first, both, atol=1e-12)


@pytest.mark.parametrize(
    ("stamps", "start", "end", "known"),
    [
        ([], 0, 1, False),
        ([0, 0.1, 0.2], 0.05, 0.15, True),
        ([0, 0.1, 0.4], 0.05, 0.45, False),  # a hole in the middle
        ([0, 0.1, 0.4], 0.05, 0.3, True),  # whether a later one is known yet does not count
        ([0, 0.1, 0.4, 0.5, 0.6], 0.45, 0.6, True),  # the hole lies before
        ([0, 0.1, 0.2], 0.1, 0.35, True),  # held after the last one
        ([0, 0.1, 0.2], 0.1, 0.45, False),  # but not for ever
        ([0.1, 0.2], 0.0, 0.2, True),
        ([0.3, 0.4], 0.0, 0.4, False),
        ([0.0], 0.1, 0.15, True),
        ([0.0], 0.3, 0.35, False),
        ([5.0], 0.0, 0.1, False),  # of another time
        ([0, 0.1], 0.1, 0.05, False),  # backwards
        ([0, 0.1], 0.1, 0.1, True),
    ],
)
def test_across_a_gap_no_rotation_is_known(
    stamps: list[float], start: float, end: float, known: bool
) -> None:
    rates = history([START + round(s * S) for s in stamps], np.ones((len(stamps), 3)))
    rot = rates.rotation(START + round(start * S), START + round(end * S))
    assert (rot is not None) == known


def test_time_that_jumps_back_starts_anew_and_a_repeated_stamp_is_dropped() -> None:
    rates = history(every(S // 10, S), np.ones((11, 3)))
    assert not rates.add(START + S, np.zeros(3))
    assert rates.add(START, np.zeros(3))
    assert len(rates) == 1
    assert rates.rotation(START + S // 2, START + S) is None


def test_what_is_old_is_forgotten_and_memory_is_bounded() -> None:
    rates = history(every(S // 10, S), np.ones((11, 3)))
    before = rates.rotation(START + 450_000_000, START + 900_000_000)
    rates.forget_before(START + 450_000_000)
    # Three of them before, by which a rate is told.
    assert len(rates) == 9
    np.testing.assert_array_equal(rates.rotation(START + 450_000_000, START + 900_000_000), before)
    for index in range(20_000):
        rates.add(START + 2 * S + index, np.zeros(3))
    assert len(rates) <= 5000


def test_a_gap_must_be_positive() -> None:
    with pytest.raises(ValueError, match="max_gap_ns"):
        RateHistory(0)


@pytest.mark.parametrize("rate", [np.zeros(2), np.zeros((1, 3)), np.array([0.0, np.nan, 0.0])])
def test_what_is_no_rate_is_not_kept(rate: np.ndarray) -> None:
    """It was, and every rotation over it raised or was NaN."""
    told = history([START], np.zeros((1, 3)))
    with pytest.raises(ValueError, match="rate must be three finite rad/s, got"):
        told.add(START + 1, rate)
    assert len(told) == 1


def test_the_rate_is_the_median_of_the_last_told_before_and_none_after_a_gap() -> None:
    step = S // 10
    rates = np.array([[0.1, 0.0, 0.0], [0.2, 0.0, 0.0], [50.0, 0.0, 0.0], [0.3, 0.0, 0.0]])
    told = history([START + i * step for i in range(4)], rates)
    # A single one may be a glitch.
    assert told.rate(START + 2 * step - 1) is None
    for stamp, want, spread in ((2, 0.2, 24.95), (3, 0.3, 24.9)):
        found = told.rate(START + stamp * step)
        assert found is not None
        assert found[0].tolist() == [want, 0.0, 0.0]
        assert found[1] == pytest.approx(spread)
    assert told.rate(START + 3 * step + GAP) is not None
    assert told.rate(START + 3 * step + GAP + 1) is None
    told.forget_before(START + 3 * step)
    assert told.rate(START + 3 * step) is not None
