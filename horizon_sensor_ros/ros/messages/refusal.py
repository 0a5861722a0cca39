"""Why a message is not used."""

from __future__ import annotations

from dataclasses import dataclass
from reprlib import Repr


@dataclass(frozen=True)
class Refusal:
    """Why a message is not used: `cause`, a word to count by, and `reason`, for a person."""

    cause: str
    reason: str


def quoted(text: str, most: int = 60) -> str:
    """Foreign text in quotes, printable, its middle left out beyond `most` characters."""
    short = Repr()
    short.maxstring = most
    return short.repr(text)
