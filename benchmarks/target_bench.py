"""The target: paper D's table, random pairs beside other registrations, honesty, time, long
sequences.

Also runs alone: `python benchmarks/target_bench.py --frames 20 --targets n5 n1`.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import cv2
from tables import Options, Table, Text
from target_beside import beside_table
from target_claims import claims_table
from target_pairs import MESHES
from target_paper import literal_table, paper_table
from target_peers import MISSING
from target_profile import profile_table
from target_sequences import sequence_table
from target_sets import RandomSet, acceptance_table, honesty_table, pairs_table, time_table

from horizon_sensor_ros.sim.tof_camera import ToFDisturbances

# Not the body of revolution, whose turn about its axis nobody can see.
TRACKED = ("n5", "n1", "winged_cylinder", "plate_with_dish", "l_truss")


def run(options: Options, targets: Sequence[str] = tuple(MESHES)) -> list[Table | Text]:
    """All tables of the target."""
    tables: list[Table | Text] = []
    if MISSING:
        left_out = "\n".join(f"{name} is left out: {why}" for name, why in MISSING.items())
        tables.append(Text("Peers", f"{left_out}\n(`make bench` installs them)"))
    tables.append(paper_table(options))
    sets = [RandomSet(name, name, options) for name in targets]
    if "n5" in targets:
        sets.append(RandomSet("n5 disturbed", "n5", options, ToFDisturbances(0.1, 0.1)))
        sets.append(RandomSet("n5 mixed pixels", "n5", options, ToFDisturbances(mixed_pixels=True)))
    hidden = [name for name in targets if name in ("n1", "n5")]
    sets += [RandomSet(f"{name} hidden", name, options, ToFDisturbances(0, 0.1)) for name in hidden]
    for each in sets:
        each.measure()
    tables += [pairs_table(sets), acceptance_table(sets), honesty_table(sets), time_table(sets)]
    tables += [claims_table(options), beside_table(options)]
    tables += [literal_table(options), profile_table(options)]
    tables.append(sequence_table(options, [name for name in targets if name in TRACKED]))
    return tables


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--frames", type=int, default=200, help="pairs a set, half as many again of n5"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--targets", nargs="+", choices=list(MESHES), default=list(MESHES))
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    for table in run(Options(arguments.frames, arguments.seed), arguments.targets):
        print(table.markdown(), flush=True)


if __name__ == "__main__":
    main()
