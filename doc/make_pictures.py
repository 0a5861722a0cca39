"""Draw the documentation's pictures: `.venv/bin/python doc/make_pictures.py [NAME ...]`."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

HERE = Path(__file__).parent
FIGURES = (
    "chain",
    "geometry",
    "frames",
    "graph",
    "architecture",
    "sections",
    "registration",
    "one_body",
    "drift",
    "cropped",
    "swept",
    "mounting",
    "edge",
    "airglow",
    "haze",
    "one_sky",
    "told",
    "watching",
)


def main() -> None:
    """Draw those that are named, or all."""
    folder = HERE / "pictures"
    folder.mkdir(exist_ok=True)
    for name in sys.argv[1:] or FIGURES:
        import_module(f"figures.{name}").draw(folder)


if __name__ == "__main__":
    main()
