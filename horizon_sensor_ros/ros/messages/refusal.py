"""Why a message is not used."""

from __future__ import annotations

from dataclasses import dataclass
from reprlib import Repr

from horizon_sensor_ros.ros.process.defect import words_of


@dataclass(frozen=True)
class Refusal:
    """Why a message is not used: `cause`, a word to count by, and `reason`, for a person."""

    cause: str
    reason: str


def internal_error(error: Exception) -> Refusal:
    """Why a message is not used that a defect of this package met."""
    return Refusal("internal_error", f"internal error: {words_of(error)}")


def quoted(text: str, most: int = 60) -> str:
    """Foreign text in quotes, printable, its middle left out beyond `most` characters."""
    short = Repr()
    short.maxstring = most
    return short.repr(text)
