"""Reasons counted for a person: those that differ by their numbers alone count as one."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator


def general(reason: str) -> str:
    """Return a reason with # for its numbers, which change from frame to frame; cameras keep
    theirs, and so do lines of files.
    """
    return re.sub(r"(?<![\w.])(?<!\.py:)-?\d+(\.\d+)?(e-?\d+)?(?![\w])", "#", reason)


class ReasonCounts:
    """How often which reason was given."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._shown: dict[str, str] = {}

    def add(self, reason: str, times: int = 1) -> None:
        """Count a reason."""
        form = general(reason)
        self._counts[form] += times
        # As it was said, where it was always the same.
        self._shown[form] = reason if self._shown.get(form, reason) == reason else form

    @property
    def total(self) -> int:
        """How many were counted."""
        return self._counts.total()

    def lines(self, most: int) -> Iterator[str]:
        """The commonest ones with their counts, and how many the others are."""
        commonest = self._counts.most_common(most)
        yield from (f"{count}: {self._shown[form]}" for form, count in commonest)
        others = self.total - sum(count for _, count in commonest)
        if others:
            yield f"{others}: other reasons"
