"""Shares and the logarithms of their odds: by their definition."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from horizon_sensor_ros.core.mathematics.odds import log_odds_of, share_of


@given(st.floats(1e-6, 1.0 - 1e-6))
def test_a_share_is_that_of_its_odds(share: float) -> None:
    assert math.exp(log_odds_of(share)) == pytest.approx(share / (1.0 - share))
    assert share_of(log_odds_of(share)) == pytest.approx(share)


def test_nine_to_one_is_nine_tenths_and_what_is_sure_is_all() -> None:
    assert share_of(math.log(9.0)) == pytest.approx(0.9)
    assert share_of(0.0) == 0.5
    assert (share_of(-1e6), share_of(1e6)) == (0.0, 1.0)
