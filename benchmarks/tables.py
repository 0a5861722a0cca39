"""Tables as people and Markdown read them, and what all parts of the benchmark are told."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
_UNITS_MARGIN = 1e-9


@dataclass(frozen=True)
class Options:
    """frames : of each set. seed : of all that is drawn at random. hard_scenes : how many.

    kinds : of hard scenes, None for all. targets : of the part of that name, None for all.
    out : directory for pictures; None for none.
    """

    frames: int = 200
    seed: int = 0
    hard_scenes: int = 500
    out: Path | None = None
    kinds: tuple[str, ...] | None = None
    targets: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Table:
    """Rows of cells under a heading; notes say what the columns mean."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"{self.title}: {len(row)} cells under {len(self.columns)} names")

    def markdown(self) -> str:
        """Return the table as Markdown that lines up as plain text too."""
        widths = [
            max(len(cell) for cell in column)
            for column in zip(self.columns, *self.rows, strict=True)
        ]
        lines = [f"## {self.title}", "", _line(self.columns, widths)]
        lines.append("|" + "|".join("-" * (width + 2) for width in widths) + "|")
        lines += [_line(row, widths) for row in self.rows]
        if self.notes:
            lines += ["", *(f"- {note}" for note in self.notes)]
        return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class Text:
    """What a part has already laid out, or why it has no table."""

    title: str
    text: str

    def markdown(self) -> str:
        """Return the text as a block of Markdown."""
        return f"## {self.title}\n\n```\n{self.text.rstrip()}\n```\n"


def verdict(value: float, bar: float) -> str:
    """`met` for a value of at most the bar, `MISSED` for a larger or unknown one; with the bar."""
    return f"{'met' if value <= bar + _UNITS_MARGIN else 'MISSED'} ({bar:g})"


def number(value: float, digits: int) -> str:
    """Fixed digits; a dash for what is not known."""
    return f"{value:.{digits}f}" if np.isfinite(value) else "-"


def root_mean_square(values: Sequence[float] | np.ndarray) -> float:
    """NaN for none."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else np.nan


def percentile(values: Sequence[float] | np.ndarray, share: float) -> float:
    """NaN for none."""
    return float(np.percentile(values, share)) if len(values) else np.nan


def shared_data() -> Path | None:
    """Directory of the shared scenes and photographs, or None: they are not in the repository."""
    directory = Path(os.environ.get("HORIZON_SHARED_DATA", ROOT.parent / "shared" / "data"))
    return directory if directory.is_dir() else None


def absent(title: str, what: str) -> Text:
    """Say that a part was skipped for want of the shared data."""
    return Text(title, f"skipped: {what} absent (set HORIZON_SHARED_DATA)")


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    first, *others = (
        cell.ljust(width) if i == 0 else cell.rjust(width)
        for i, (cell, width) in enumerate(zip(cells, widths, strict=True))
    )
    return "| " + " | ".join([first, *others]) + " |"
