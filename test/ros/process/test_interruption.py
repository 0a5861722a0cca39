"""What a signal breaks off, and what it does not. Real signals, in the main thread."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from types import FrameType

import pytest

from horizon_sensor_ros.ros.process.interruption import Interrupted, Interruption

TURNS = 10**9  # of a loop, far more than the signal takes


@pytest.fixture
def end() -> Iterator[Interruption]:
    """One that SIGALRM asks for."""
    interruption = Interruption()

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        interruption.ask()

    before = signal.signal(signal.SIGALRM, on_signal)
    yield interruption
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGALRM, before)


def work(end: Interruption) -> int:
    """Turns until it is asked for, or too many."""
    for turn in range(TURNS):
        if end.asked_for:
            return turn
    return TURNS


def test_breakable_work_is_broken_off(end: Interruption) -> None:
    signal.setitimer(signal.ITIMER_REAL, 0.05)
    with pytest.raises(Interrupted), end.breakable():
        work(end)
    assert end.asked_for


def test_no_handler_of_errors_keeps_it(end: Interruption) -> None:
    """As the pipeline's last defence, which catches every Exception."""
    signal.setitimer(signal.ITIMER_REAL, 0.05)
    with pytest.raises(Interrupted), end.breakable(), suppress(Exception):
        work(end)


def test_other_work_is_finished(end: Interruption) -> None:
    with end.breakable():
        pass
    signal.setitimer(signal.ITIMER_REAL, 0.05)
    assert work(end) < TURNS
    assert end.asked_for


def test_nothing_is_begun_once_it_is_asked_for(end: Interruption) -> None:
    end.ask()
    with pytest.raises(Interrupted), end.breakable():
        pytest.fail("begun")


def test_what_is_broken_off_has_no_result(end: Interruption) -> None:
    assert end.result_of(lambda: 7) == 7
    signal.setitimer(signal.ITIMER_REAL, 0.05)
    assert end.result_of(lambda: work(end)) is None
    assert end.result_of(lambda: pytest.fail("begun")) is None


def test_an_error_of_the_work_goes_on(end: Interruption) -> None:
    with pytest.raises(ValueError, match="bad"), end.breakable():
        raise ValueError("bad")
    end.ask()  # not in such work any more: no exception


def test_an_end_that_is_stuck_outside_python_is_cut_short() -> None:
    """As in a library that does not return, and keeps the interpreter."""
    code = """
import ctypes
from horizon_sensor_ros.ros.process import executable

executable._END_S = 1
executable._QuietEnd.begin()
ctypes.PyDLL(None).pause()
"""
    process = subprocess.run([sys.executable, "-c", code], check=False, timeout=60.0)
    assert process.returncode == -signal.SIGALRM
