"""Nanoseconds in seconds, and back."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from horizon_sensor_ros.core.seconds import nearest_s_from_ns, ns_from_s, s_from_ns

spans = st.integers(-(10**15), 10**15)


@pytest.mark.parametrize("in_seconds", [s_from_ns, nearest_s_from_ns])
@given(span_ns=spans)
def test_seconds_are_nanoseconds_again(in_seconds: Callable[..., Any], span_ns: int) -> None:
    assert ns_from_s(in_seconds(span_ns)) == span_ns
    assert in_seconds(np.array([span_ns]))[0] == in_seconds(span_ns)


@given(span_ns=spans)
def test_one_is_the_nearest_number_and_the_other_off_by_a_bit(span_ns: int) -> None:
    # Python rounds a fraction to the nearest number.
    exact = float(Fraction(span_ns, 10**9))
    assert nearest_s_from_ns(span_ns) == exact
    assert abs(s_from_ns(span_ns) - exact) <= np.spacing(abs(exact))
