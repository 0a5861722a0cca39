"""Every command: its --help has an example, and what it cannot do it says without a traceback."""

from __future__ import annotations

import re
import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = "horizon_sensor_ros"
COMMANDS = dict(re.findall(r'"(\w+)": "((?:ros|tools)\.[\w.]+)"', (ROOT / "setup.py").read_text()))
TOOLS = sorted(name for name, module in COMMANDS.items() if module.startswith("tools."))


def run(name: str, *arguments: str) -> int:
    """Exit code of a command's entry point."""
    main = import_module(f"{PACKAGE}.{COMMANDS[name]}").main
    try:
        return main(list(arguments)) if name in TOOLS else main()
    except SystemExit as end:
        return int(end.code or 0)


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_help_has_an_example(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    assert run(name, "--help") == 0
    text = capsys.readouterr().out
    assert text.startswith("usage: ")
    _, found, examples = text.lower().partition("example")
    assert found, "an example"
    assert f"{name} " in examples, "of this very command"
    assert max(map(len, text.splitlines())) <= 100


@pytest.mark.parametrize("name", TOOLS)
def test_unknown_options_are_named(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(name, "--no-such-option") != 0
    said = capsys.readouterr().err
    assert said.startswith("usage: ")
    assert f"\n{name}: error: " in said


@pytest.mark.parametrize("name", ["horizon_replay", "horizon_report", "horizon_self_calibration"])
def test_a_second_parameter_file_is_not_taken_for_the_first(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(name, "bag", "out", "--params", "base.yaml", "--params", "mine.yaml") == 2
    assert f"{name}: error: argument --params: is there twice" in capsys.readouterr().err


@pytest.mark.parametrize("name", [name for name in TOOLS if name != "horizon_demo"])
def test_a_missing_input_is_named(
    name: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    nowhere = str(tmp_path / "nowhere")
    out = str(tmp_path / "out")
    arguments = {
        "horizon_replay": [nowhere, out],
        "horizon_bag_to_csv": [nowhere, out],
        "horizon_bag_from_images": [out, "--clouds", nowhere],
        "horizon_self_calibration": [nowhere, "--params", nowhere],
        # Not the report.html that the README's command may have left.
        "horizon_report": [nowhere, "--out", out],
    }.get(name, [nowhere])
    assert run(name, *arguments) == 1
    said = capsys.readouterr().err
    assert nowhere in said
    assert name in said
    assert "Traceback" not in said
    assert "Errno" not in said
    assert not list(tmp_path.iterdir())
