"""How light fades behind an edge, in columns of which some show none."""

from __future__ import annotations

import numpy as np
import pytest

from horizon_sensor_ros.core.limb.search.columns import DEPTHS_M
from horizon_sensor_ros.core.limb.search.layer_light import (
    ends_above,
    fades_alike,
    fades_as_a_shell,
    falls_short,
    is_air,
    is_shell,
)

COLUMNS = 12
CREST_M = float(DEPTHS_M[DEPTHS_M > 0.0].min())


def shell() -> np.ndarray:
    """Brightness of columns below the edge of a shell that thins as one over the root of the depth,
    closed form; none above the edge.
    """
    law = np.where(DEPTHS_M > 0.0, np.sqrt(CREST_M / np.maximum(DEPTHS_M, CREST_M)), 0.0)
    return np.tile(40.0 * law, (COLUMNS, 1))


@pytest.mark.parametrize("dark", [0.0, -0.5])
def test_columns_without_light_decide_nothing(dark: float) -> None:
    level = np.concatenate([shell(), np.full((2, len(DEPTHS_M)), dark)])
    crest, at_trough = level.max(axis=1), np.full(len(level), len(DEPTHS_M) - 1)
    assert (crest[-2:] <= 0.0).all()
    law = fades_as_a_shell(level[:COLUMNS], crest[:COLUMNS])
    assert law == pytest.approx(np.sqrt(CREST_M))
    with np.errstate(all="raise"):
        assert fades_as_a_shell(level, crest) == pytest.approx(law)
        assert fades_alike(level, crest, at_trough)
        assert ends_above(level, crest)
        assert not falls_short(level, crest)
        assert is_shell(level, crest) == is_shell(level[:COLUMNS], crest[:COLUMNS])
        assert is_air(level, crest) == is_air(level[:COLUMNS], crest[:COLUMNS])
