"""Hard scenes of every kind, by our own renderer: what is fixed, what is refused, what is wrong."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from horizon_errors import angle_deg, nadir_sigma_deg
from tables import Options, Table, number, percentile
from tqdm import tqdm

from horizon_sensor_ros.core.horizon_sensor import Frame, HorizonSensor
from horizon_sensor_ros.sim.hard_scenes import KINDS, hard_scenes

WRONG_DEG, WRONG_SIGMAS = 1.0, 3.0
COLUMNS = (
    "kind",
    "solvable",
    "fixed",
    "no limb",
    "fixed, no limb",
    "between",
    "fixed, between",
    "median, deg",
    "max, deg",
    "over 3 sigma",
    "wrong",
)
_EXPECT = ("fix", "none", "either")


@dataclass
class _Tally:
    scenes: dict[str, int] = field(default_factory=lambda: dict.fromkeys(_EXPECT, 0))
    fixed: dict[str, int] = field(default_factory=lambda: dict.fromkeys(_EXPECT, 0))
    errors_deg: list[float] = field(default_factory=list)
    beyond_sigmas: int = 0
    wrong: list[str] = field(default_factory=list)

    def row(self, kind: str) -> tuple[str, ...]:
        counts = [str(n) for what in _EXPECT for n in (self.scenes[what], self.fixed[what])]
        return (
            kind,
            *counts,
            number(percentile(self.errors_deg, 50), 4),
            number(percentile(self.errors_deg, 100), 4),
            str(self.beyond_sigmas),
            f"{len(self.wrong)} MISSED" if self.wrong else "0",
        )


def run(options: Options) -> list[Table]:
    """One row a kind, and all of them."""
    tallies = {kind: _Tally() for kind in KINDS}
    everything = _Tally()
    sensor = HorizonSensor()
    scenes = hard_scenes(options.frames, options.seed)
    for scene in tqdm(scenes, total=options.frames, desc="Hard scenes", unit="scene"):
        sensor.reset()
        drawn = zip(scene.views, scene.frames, strict=True)
        fix = sensor.process([Frame(view, frame.image) for view, frame in drawn])
        error = angle_deg(fix.fit.nadir_base, scene.frames[0].truth.nadir_base)
        for tally in (tallies[scene.kind], everything):
            tally.scenes[scene.expect] += 1
            if not fix.ok:
                continue
            sigma = nadir_sigma_deg(fix.fit.cov_nadir_altitude[:3, :3])
            tally.fixed[scene.expect] += 1
            tally.errors_deg.append(error)
            tally.beyond_sigmas += error > WRONG_SIGMAS * sigma
            if error > WRONG_DEG and error > WRONG_SIGMAS * sigma:
                tally.wrong.append(scene.name)
    rows = [tally.row(kind) for kind, tally in tallies.items() if any(tally.scenes.values())]
    solvable = everything.scenes["fix"]
    share = 100.0 * everything.fixed["fix"] / solvable if solvable else np.nan
    fixes = sum(everything.fixed.values())
    notes = (
        "Two perpendicular 640 x 480 cameras, both given to the sensor with its default settings. "
        "solvable: at least one camera shows 200 px of clear, lit, unhidden limb; no limb: neither "
        "shows 40 px; between: the rest. By the drawn scene's truth, not by its kind.",
        f"Of the {solvable} solvable, {number(share, 1)} % are fixed; of the "
        f"{everything.scenes['none']} without a limb, {everything.fixed['none']}.",
        "median, max: nadir error of all fixes (geocentric, also of the ellipsoid of wgs84, which "
        "the sensor takes for a sphere). over 3 sigma: fixes whose error is above three sigma of "
        "its own least certain direction; the normal law allows 1.1 % or fewer of "
        f"{fixes} fixes.",
        f"wrong: above {WRONG_DEG:g} deg and above three sigma: "
        f"{', '.join(everything.wrong) or 'none'}.",
    )
    return [
        Table(
            f"Hard scenes ({options.frames})",
            COLUMNS,
            (*rows, everything.row("all")),
            notes,
        )
    ]
