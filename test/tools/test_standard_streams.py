"""What cannot be printed does not end a command."""

from __future__ import annotations

import errno
import io
import os
import sys

import pytest

from horizon_sensor_ros.tools.command import run_command
from horizon_sensor_ros.tools.standard_streams import lasting_streams


def test_a_full_output_is_kept_in_mind_and_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    with open("/dev/full", "w", encoding="utf-8") as full:
        monkeypatch.setattr(sys, "stdout", full)
        with lasting_streams() as output:
            print("lost")
            output.flush()
            assert output.error is not None
            assert output.error.errno == errno.ENOSPC
            print("lost too", flush=True)
        assert sys.stdout is full
        # Nothing is held back that would fail when the interpreter ends.
        full.flush()


def test_streams_that_are_none_can_be_printed_to(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("stdout", "stderr"):
        monkeypatch.setattr(sys, name, None)
    with lasting_streams() as output:
        print("lost", flush=True)
        print("lost", file=sys.stderr, flush=True)
        assert output.error is None
    assert sys.stdout is sys.stderr is None


def test_letters_that_an_output_lacks_are_spelt(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files were written, and then their names could not be printed: an error, and no output."""
    for encoding, printed in (("ascii", "m\\xe4h\\udcff"), ("utf-8", "mäh\\udcff")):
        raw = io.BytesIO()
        monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding=encoding))
        with lasting_streams() as output:
            # The last one is a byte of a file's name that is no letter.
            print("mäh\udcff")
        assert output.error is None
        assert raw.getvalue().decode(encoding) == f"{printed}\n"


@pytest.mark.parametrize("reader", [True, False])
def test_the_exit_code_tells_of_a_full_output_but_not_of_one_that_is_read_no_further(
    reader: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def work(_: object) -> str:
        print("the answer")
        return "written"

    if reader:
        number = os.open("/dev/full", os.O_WRONLY)
    else:
        end, number = os.pipe()
        os.close(end)
    with os.fdopen(number, "w") as output:
        monkeypatch.setattr(sys, "stdout", output)
        assert run_command("name", work) == reader
    told = capsys.readouterr().err
    assert told.startswith("written\n")
    assert ("name: cannot write to the standard output: No space left" in told) == reader
