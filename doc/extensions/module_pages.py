"""Fills the pages of api/: a page names packages and gets a section for each of their modules."""

from __future__ import annotations

import pkgutil
import re
from importlib import import_module
from typing import Any

from sphinx.application import Sphinx

_MARKER = re.compile(r"^\.\. modules of (\S+?)(?: except (.+))?$", re.MULTILINE)


def setup(app: Sphinx) -> dict[str, Any]:
    """Listen to the pages as they are read."""
    app.connect("source-read", _fill)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def modules_of(package: str, others: tuple[str, ...] = ()) -> list[str]:
    """Full names of the modules of a package and of its packages, those in `others` left out."""
    found = []
    for entry in pkgutil.iter_modules(import_module(package).__path__, f"{package}."):
        short = entry.name.removeprefix(f"{package}.")
        if short in others or short.startswith("_"):
            continue
        found += modules_of(entry.name) if entry.ispkg else [entry.name]
    return found


def _fill(app: Sphinx, docname: str, source: list[str]) -> None:
    if docname.startswith("api/"):
        source[0] = _MARKER.sub(_sections, source[0])


def _sections(match: re.Match[str]) -> str:
    others = tuple((match[2] or "").replace(",", " ").split())
    return "\n".join(_section(name) for name in modules_of(match[1], others))


def _section(name: str) -> str:
    title = name.removeprefix("horizon_sensor_ros.")
    return "\n".join([title, "-" * len(title), "", f".. automodule:: {name}", "", ""])
