"""Paper D's table, random pairs beside other registrations, honesty, time, long sequences."""

from __future__ import annotations

from horizon_sensor_ros.sim.tof_camera import ToFDisturbances
from tables import Options, Table, Text
from target.pairs import MESHES
from target.paper import literal_table, paper_table
from target.peers import MISSING
from target.profile import profile_table
from target.sequences import sequence_table
from target.sets import RandomSet, acceptance_table, honesty_table, pairs_table, time_table

# Not the body of revolution, whose turn about its axis nobody can see.
TRACKED = ("n5", "n1", "winged_cylinder", "plate_with_dish", "l_truss")


def run(options: Options) -> list[Table | Text]:
    """The tables, of pairs of some targets or of all."""
    targets = options.targets or tuple(MESHES)
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
    tables += [literal_table(options), profile_table(options)]
    tables.append(sequence_table(options, [name for name in targets if name in TRACKED]))
    return tables
