"""A limb whose height differs from place to place: errors, and what they are claimed to be."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from horizon_errors import BEYOND_NEES, fit_errors
from tables import Options, Table, number, percentile
from tqdm import tqdm

from horizon_sensor_ros.core.horizon_config import HorizonConfig
from horizon_sensor_ros.core.horizon_fix import Frame
from horizon_sensor_ros.core.horizon_sensor import HorizonSensor
from horizon_sensor_ros.sim.hard_scenes import HardScene, hard_scene

COLUMNS = (
    "scenes",
    "uneven by",
    "told",
    "cameras",
    "fixed",
    "nadir median",
    "max",
    "NEES",
    "beyond 3 sigma",
    "altitude / sigma, RMS",
)
_KINDS = ("clouds", "air")
_UNEVEN_M = (0.0, 300.0, 1000.0, 3000.0)
_OF_SCENES = 20  # scenes a row: one of so many hard ones
NOTES = (
    "Hard scenes of two kinds, with waves of 200 to 6000 km in the height of the visible limb, of "
    "so many metres (one sigma), as cloud tops make them; told: `limb_unevenness` is that, or 0. "
    "Each pair, and each of its cameras by itself.",
    "nadir: angle to the true one, degrees. NEES: mean of the squared nadir error in the fit's own "
    "sigmas (2 is right); beyond 3 sigma: share of it above 11.8.",
)


@dataclass
class _Row:
    """Errors of fixes: nadir's, degrees, its NEES, and altitude's over its sigma."""

    tried: int = 0
    errors: list[tuple[float, float, float]] = field(default_factory=list)

    def cells(self) -> tuple[str, ...]:
        """From the column `fixed` on."""
        if not self.errors:
            return (f"0/{self.tried}", "", "", "", "", "")
        nadir, nees, altitude = np.array(self.errors).T
        return (
            f"{len(nadir)}/{self.tried}",
            number(percentile(nadir, 50), 4),
            number(percentile(nadir, 100), 3),
            number(float(nees.mean()), 1),
            str(np.count_nonzero(nees > BEYOND_NEES)),
            number(float(np.sqrt(np.mean(np.square(altitude)))), 1),
        )


def uneven(scene: HardScene, uneven_m: float, seed: int) -> list[Frame]:
    """The frames of a scene, drawn with an uneven limb."""
    world = replace(scene.scene, limb_uneven_m=uneven_m)
    drawn = scene.redrawn(world, np.random.default_rng(seed))
    return [Frame(view, frame.image) for view, frame in zip(scene.views, drawn, strict=True)]


def run(options: Options) -> list[Table]:
    """One row a kind, an unevenness, what is told of it, and pairs or single cameras."""
    count = max(1, options.hard_scenes // _OF_SCENES)
    rows = []
    for kind in _KINDS:
        for uneven_m in _UNEVEN_M:
            told = dict.fromkeys((0.0, uneven_m))
            found = {(m, cameras): _Row() for m in told for cameras in (2, 1)}
            sensors = {
                m: HorizonSensor(HorizonConfig(tracking=False, limb_unevenness_m=m)) for m in told
            }
            for i in tqdm(range(count), desc=f"{kind}, {uneven_m:.0f} m", unit="scene"):
                scene = hard_scene(kind, i, options.seed)
                truth = scene.frames[0].truth
                frames = uneven(scene, uneven_m, i)
                for (m, cameras), row in found.items():
                    for shown in [frames] if cameras == 2 else [[frame] for frame in frames]:
                        fix = sensors[m].process(shown)
                        row.tried += 1
                        if fix.ok:
                            error = fit_errors(fix.fit, truth.nadir_base, truth.altitude_m)
                            sigma_m = float(np.sqrt(fix.fit.cov_nadir_altitude[3, 3]))
                            off = (fix.fit.altitude_m - truth.altitude_m) / sigma_m
                            row.errors.append((error.nadir_deg, error.nees, off))
            rows += [
                (kind, f"{uneven_m:.0f} m", f"{m:.0f} m", str(cameras), *row.cells())
                for (m, cameras), row in found.items()
            ]
    return [Table(f"Uneven limbs ({count} scenes a row)", COLUMNS, tuple(rows), NOTES)]
