"""What is told of a defect of the package: enough to find it by."""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np
import pytest

from horizon_sensor_ros.core.mathematics.rigid import vector_from_rotation
from horizon_sensor_ros.ros.messages.refusal import internal_error
from horizon_sensor_ros.ros.process.defect import words_of
from horizon_sensor_ros.tools.reasons import ReasonCounts


def test_the_innermost_line_of_the_package_is_named() -> None:
    with pytest.raises(IndexError) as raised:
        vector_from_rotation(np.zeros((2, 2)))
    line = raised.traceback[-1].lineno + 1
    assert (
        words_of(raised.value) == f"IndexError: {raised.value} at core/mathematics/rigid.py:{line}"
    )


def test_lines_beyond_the_package_are_not_named() -> None:
    """The line that can be mended is the one that asked for it."""

    class Broken:
        def __array__(self, *_: object) -> np.ndarray:
            raise LookupError("elsewhere")

    with pytest.raises(LookupError, match="elsewhere") as raised:
        vector_from_rotation(cast(np.ndarray, Broken()))
    line = raised.traceback[-2].lineno + 1
    assert words_of(raised.value) == f"LookupError: elsewhere at core/mathematics/rigid.py:{line}"


def test_an_error_from_elsewhere_has_no_line_of_the_package() -> None:
    assert words_of(KeyError("k")) == "KeyError: 'k'"
    with pytest.raises(OSError, match="full") as raised:
        raise OSError("full")
    assert words_of(raised.value) == "OSError: full"
    assert words_of(cv2.error("two\nlines\n")) == "error: two lines"
    refusal = internal_error(raised.value)
    assert refusal.cause == "internal_error"
    assert refusal.reason == "internal error: OSError: full"


def test_a_tally_of_reasons_keeps_the_lines_of_files() -> None:
    counts = ReasonCounts()
    for index, line in ((5, 108), (7, 108), (5, 33)):
        counts.add(f"internal error: IndexError: index {index} at core/limb/detector.py:{line}")
    assert list(counts.lines(5)) == [
        "2: internal error: IndexError: index # at core/limb/detector.py:108",
        "1: internal error: IndexError: index 5 at core/limb/detector.py:33",
    ]
