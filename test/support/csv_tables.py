"""Tables that the package's commands write, as one reads them."""

from __future__ import annotations

import csv
from pathlib import Path


def table(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file, each by the columns' names."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))
