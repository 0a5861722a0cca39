"""Some of many, spread evenly."""

from __future__ import annotations

import numpy as np
import pytest

from horizon_sensor_ros.core.limb.search.evenly import evenly


@pytest.mark.parametrize(("length", "count"), [(1, 24), (5, 24), (24, 24), (200, 24)])
def test_none_is_taken_twice(length: int, count: int) -> None:
    numbers = evenly(length, count)
    assert len(numbers) == min(length, count)
    assert numbers[0] == 0
    assert numbers[-1] == length - 1
    assert (np.diff(numbers) > 0).all()
