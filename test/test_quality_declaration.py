"""What QUALITY_DECLARATION.md says and a machine can check."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "QUALITY_DECLARATION.md").read_text()


def test_files_and_targets_that_it_names_are_there() -> None:
    names = re.findall(r"`([\w./-]+)`", TEXT)
    files = [name for name in names if "/" in name or name == "LICENSE" or name.endswith(".md")]
    assert len(files) > 8
    for name in files:
        assert (ROOT / name).exists(), name
    targets = re.findall(r"^([a-z-]+):.*## ", (ROOT / "Makefile").read_text(), re.M)
    for target in re.findall(r"`make ([a-z-]+)`", TEXT):
        assert target in targets


def test_version_license_and_dependencies() -> None:
    manifest = ET.parse(ROOT / "package.xml").getroot()
    assert f"Version {manifest.findtext('version')}" in TEXT
    assert manifest.findtext("license") == "Apache-2.0"
    assert "Apache License" in (ROOT / "LICENSE").read_text()[:500]
    others = {
        element.text.removeprefix("python3-").removesuffix("-pip")
        for element in manifest.iter("exec_depend")
        if element.text and element.text.startswith("python3-")
    }
    (line,) = [line for line in TEXT.splitlines() if "5.iii" in line]
    named = line.lower().replace("pyyaml", "yaml")
    assert all(other in named for other in others), others


def test_linters_ask_for_docstrings() -> None:
    settings = (ROOT / "pyproject.toml").read_text()
    assert '"D1"' in settings
    assert "[tool.mypy]" in settings


def test_a_level_below_what_is_lacking() -> None:
    (level,) = re.findall(r"\*\*quality level (\d)\*\*", TEXT)
    # Levels 1 and 2 need version 1.0, change requests, coverage, a disclosure policy.
    assert int(level) >= 4
