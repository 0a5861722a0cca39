"""The benchmark: runs its parts, prints their tables and writes them to a directory.

A missed bar is marked MISSED in its row and does not change the exit code; a part that breaks does.
Beside it are commands of their own: ros_latency.py, transport.py and two_hosts.py (live nodes),
soak.py (a million pairs and clouds), demo_flights.py (the demo's flight, and others like it),
target_claims.py (claims of pairs of random bodies), target_beside.py (clouds of more than the
target).
"""

from __future__ import annotations

import argparse
import importlib
import os
import platform
import sys
import time
import traceback
from pathlib import Path

# Times are those of one thread; the libraries look at these when they are first imported.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"

# Name of a part: module beside this file whose `run(options)` returns tables.
PARTS = {
    "horizon_methods": "horizon_methods",
    "paper_b": "paper_b",
    "paper_c": "paper_c",
    "horizon_scenes": "horizon_scenes",
    "horizon_hard": "horizon_hard",
    "horizon_alone": "horizon_alone",
    "horizon_figure": "horizon_figure",
    "horizon_sun": "horizon_sun",
    "horizon_motion": "horizon_motion",
    "horizon_readout": "horizon_readout",
    "horizon_told": "horizon_told",
    "horizon_timing": "horizon_timing",
    "self_calibration": "self_calibration",
    "lens_blur": "lens_blur",
    "target": "target_bench",
    "target_swept": "target_swept",
    "target_latency": "target_latency",
}


def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--only", nargs="+", choices=list(PARTS), metavar="NAME", help=f"of: {', '.join(PARTS)}"
    )
    parser.add_argument("--frames", type=int, default=200, help="frames a set (default 200)")
    parser.add_argument("--hard-scenes", type=int, default=500, help="how many (default 500)")
    parser.add_argument(
        "--kinds", nargs="+", metavar="KIND", help="of hard scenes (default all, in turn)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of all random draws (default 0)")
    parser.add_argument("--out", type=Path, default=Path("bench_output"), help="directory")
    arguments = parser.parse_args(argv)
    for name in ("frames", "hard_scenes"):
        if getattr(arguments, name) < 1:
            flag = name.replace("_", "-")
            parser.error(f"--{flag} must be at least 1, got {getattr(arguments, name)}")

    kinds = tuple(arguments.kinds) if arguments.kinds else None
    try:
        importlib.import_module("horizon_sensor_ros.sim.hard_scenes").hard_scenes(0, kinds=kinds)
    except ValueError as error:
        parser.error(f"--kinds: {error}")

    cv2 = importlib.import_module("cv2")
    numpy = importlib.import_module("numpy")
    options = importlib.import_module("tables").Options(
        arguments.frames,
        arguments.seed,
        arguments.hard_scenes,
        arguments.out,
        kinds,
    )
    cv2.setNumThreads(1)
    arguments.out.mkdir(parents=True, exist_ok=True)
    print(
        f"{platform.machine()}, Python {platform.python_version()}, numpy {numpy.__version__}, "
        f"OpenCV {cv2.__version__}; {arguments.frames} frames a set, seed {arguments.seed}\n"
    )
    broken = []
    for name in arguments.only or PARTS:
        start = time.perf_counter()
        try:
            tables = importlib.import_module(PARTS[name]).run(options)
        except Exception:
            traceback.print_exc()
            broken.append(name)
            continue
        text = "\n".join(table.markdown() for table in tables)
        (arguments.out / f"{name}.md").write_text(text, encoding="utf-8")
        print(f"{text}\n({name}: {time.perf_counter() - start:.0f} s)\n", flush=True)
    if broken:
        print(f"broken: {', '.join(broken)}", file=sys.stderr)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
