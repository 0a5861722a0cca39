"""A very short soak: the long one is `make soak`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SOAK = Path(__file__).parents[1] / "benchmarks" / "soak.py"


def test_it_runs_draws_and_holds_its_handles(tmp_path: Path) -> None:
    picture = tmp_path / "soak.png"
    done = subprocess.run(
        [sys.executable, str(SOAK), "--count", "400", "--picture", str(picture)],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    # Memory may still be warming up after so few: 1 is no failure here.
    assert done.returncode in (0, 1), done.stderr
    assert "400 pairs and clouds" in done.stdout
    assert "4 horizon fixes, 4 target fixes" in done.stdout
    assert "more than at the start" not in done.stdout
    assert picture.stat().st_size > 1000
