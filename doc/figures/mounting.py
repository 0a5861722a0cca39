"""Where to mount the cameras: pictures of `horizon_applicability` for config/two_cameras.yaml."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from tempfile import TemporaryDirectory

from horizon_sensor_ros.tools.applicability.applicability import main

_FILE = str(Path(__file__).parents[2] / "config" / "two_cameras.yaml")
# Each picture, and the command that draws it.
COMMANDS = {
    "quality.png": ("--quality", "--range", "-40", "40", "--step", "2"),
    "mounting.png": ("--mounting", "300", "1200", "--tilt", "5"),
    "figure6-wide.png": ("--figure6", "--step", "1"),
}


def draw(folder: Path) -> None:
    """Write the pictures; the answers go to the terminal."""
    with TemporaryDirectory() as place:
        for name, options in COMMANDS.items():
            prefix = Path(place) / Path(name).stem
            file = [] if "--figure6" in options else [_FILE]
            answer = io.StringIO()
            with contextlib.redirect_stdout(answer):
                main([*file, *options, "-o", str(prefix)])
            (folder / name).write_bytes(prefix.with_suffix(".png").read_bytes())
            print(answer.getvalue().split("; wrote")[0])
