"""The benchmark: runs its parts, prints their tables and writes them to a directory.

A missed bar is marked MISSED in its row and does not change the exit code; a part that breaks does.
benchmarks/README.md names the commands beside it, and what is in which folder.
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

# Name of a part: module whose `run(options)` returns tables. They import each other as from here,
# the folder that Python searches first for whatever script of it runs.
PARTS = {
    "horizon_methods": "horizon.methods",
    "paper_b": "horizon.paper_b",
    "paper_c": "horizon.paper_c",
    "horizon_scenes": "horizon.scenes",
    "horizon_hard": "horizon.hard",
    "horizon_alone": "horizon.alone",
    "horizon_figure": "horizon.figure",
    "horizon_sun": "horizon.sun",
    "horizon_motion": "horizon.motion",
    "horizon_readout": "horizon.readout",
    "horizon_told": "horizon.told",
    "horizon_timing": "horizon.timing",
    "self_calibration": "calibration.self_calibration",
    "lens_blur": "calibration.lens_blur",
    "target": "target.bench",
    "target_claims": "target.claims",
    "target_beside": "target.beside",
    "target_swept": "target.swept",
    "target_latency": "nodes.target_latency",
}


def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; return the exit code."""
    parser = _parser()
    arguments = parser.parse_args(argv)
    _check(parser, arguments)
    cv2 = importlib.import_module("cv2")
    numpy = importlib.import_module("numpy")
    options = importlib.import_module("tables").Options(
        arguments.frames,
        arguments.seed,
        arguments.hard_scenes,
        arguments.out,
        *(tuple(names) if names else None for names in (arguments.kinds, arguments.targets)),
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


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--only", nargs="+", choices=list(PARTS), metavar="NAME", help=f"of: {', '.join(PARTS)}"
    )
    parser.add_argument("--frames", type=int, default=200, help="frames a set (default 200)")
    parser.add_argument("--hard-scenes", type=int, default=500, help="how many (default 500)")
    parser.add_argument(
        "--kinds", nargs="+", metavar="KIND", help="of hard scenes (default all, in turn)"
    )
    parser.add_argument(
        "--targets", nargs="+", metavar="TARGET", help="of the part target (default all)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of all random draws (default 0)")
    parser.add_argument("--out", type=Path, default=Path("bench_output"), help="directory")
    return parser


def _check(parser: argparse.ArgumentParser, arguments: argparse.Namespace) -> None:
    """End with a message if something is not known or too small."""
    for name in ("frames", "hard_scenes"):
        if getattr(arguments, name) < 1:
            flag = name.replace("_", "-")
            parser.error(f"--{flag} must be at least 1, got {getattr(arguments, name)}")
    # Not above: what they import is to find the environment set.
    kinds = importlib.import_module("horizon_sensor_ros.sim.hard_kinds").ALL_KINDS
    targets = importlib.import_module("horizon_sensor_ros.sim.shapes").TARGETS
    for name, known in (("kinds", kinds), ("targets", targets)):
        if unknown := set(getattr(arguments, name) or ()) - set(known):
            parser.error(
                f"--{name}: unknown {name} {sorted(unknown)}; known are {', '.join(known)}"
            )


if __name__ == "__main__":
    sys.exit(main())
