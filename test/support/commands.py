"""The package's commands, called in this process as a person calls them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

Main = Callable[[list[str]], int]


def called(main: Main, *arguments: Any) -> int:
    """Exit code of a command with these arguments."""
    return main([str(argument) for argument in arguments])


def refusal(main: Main, capsys: pytest.CaptureFixture[str], *arguments: Any, code: int = 1) -> str:
    """Call what has to fail with an exit code; what it says."""
    assert called(main, *arguments) == code
    said = capsys.readouterr().err
    assert "Traceback" not in said
    return said
