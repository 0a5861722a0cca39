"""Docstrings are plain text with `names` in backquotes; here they become what Sphinx reads."""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

_CODE = re.compile(r"(``.+?``|`[^`]+`)", re.DOTALL)
_SPECIAL = re.compile(r"([\\*|_<>\[\]])")
# "limb_px : (N, 2)" at the beginning of a line or a sentence: the description of an argument.
_ARGUMENT = re.compile(r"(^|(?<=[.;] ))(\w+(?:, \w+)*) : ", re.MULTILINE)
_MODULE = re.compile(r"~?\b(?:[a-z_]\w*\.)+(?=[A-Z]|ndarray)")
_ITEM = re.compile(r"[*-] ")


def setup(app: Sphinx) -> dict[str, Any]:
    """Listen to what autodoc reads."""
    app.connect("autodoc-process-docstring", _rewrite)
    app.connect("autodoc-process-signature", _shorten)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _rewrite(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Replace a docstring's lines by reStructuredText that means the same."""
    paragraphs = re.split(r"\n\s*\n", "\n".join(lines).strip("\n"))
    text = "\n\n".join(_paragraph(p) for p in paragraphs if p.strip())
    lines[:] = [*text.split("\n"), ""]


def _shorten(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, arguments: str, returned: str
) -> tuple[str, str]:
    """Names of types without their modules."""
    short = (_MODULE.sub("", text) if text else text for text in (arguments, returned))
    return tuple(short)


def _paragraph(text: str) -> str:
    lines = text.split("\n")
    if all(line.startswith("    ") for line in lines):
        return "::\n\n" + text
    items = [i for i, line in enumerate(lines) if _ITEM.match(line)]
    if items and items[0] == 0:
        ends = [*items[1:], len(lines)]
        listed = (lines[start:end] for start, end in zip(items, ends, strict=True))
        return "\n".join("* " + _escaped(_joined(item)[2:]) for item in listed)
    if items:
        start = items[0]
        return "\n\n".join(_paragraph("\n".join(part)) for part in (lines[:start], lines[start:]))
    return _escaped("\n".join(line.strip() for line in lines))


def _joined(lines: list[str]) -> str:
    return " ".join(line.strip() for line in lines)


def _escaped(text: str) -> str:
    """Code in double backquotes; elsewhere nothing is markup but the names of arguments."""
    text = _ARGUMENT.sub(lambda m: f"{m[1]}``{m[2]}`` : ", text)
    pieces = _CODE.split(text)
    for i, piece in enumerate(pieces):
        if i % 2:
            inside = " ".join(piece.strip("`").split())
            # Markup needs an edge on both sides: "\ " is one that is not printed.
            pieces[i] = f"\\ ``{inside}``\\ "
        else:
            pieces[i] = _SPECIAL.sub(r"\\\1", piece)
    return "".join(pieces)
