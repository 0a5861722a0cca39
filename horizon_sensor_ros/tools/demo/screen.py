"""What the demo shows in the terminal while it flies."""

from __future__ import annotations

from collections.abc import Mapping

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

_FIGURE_WIDTH = 34


class FlightScreen:
    """Progress of the flight and, under it, the latest figures by their names.

    Where there is no terminal it is drawn once, at the end.
    """

    def __init__(self, total: int, console: Console | None = None) -> None:
        self._progress = Progress(
            TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(),
            TimeRemainingColumn(),
        )  # fmt: skip
        self._task = self._progress.add_task("waiting for the nodes", total=total)
        self._live = Live(self._progress, console=console, refresh_per_second=5)

    def __enter__(self) -> FlightScreen:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def say(self, what: str) -> None:
        """Name what is going on."""
        self._progress.update(self._task, description=what)

    def advance(self, figures: Mapping[str, str]) -> None:
        """Take note of one more moment, and show the latest figures."""
        self._progress.advance(self._task)
        self._live.update(Group(self._progress, _table(figures)))


def _table(figures: Mapping[str, str]) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
    table.add_column(style="dim")
    table.add_column(min_width=_FIGURE_WIDTH, no_wrap=True)
    for name, value in figures.items():
        table.add_row(name, value)
    return table
