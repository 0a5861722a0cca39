"""What frames cannot tell: uneven limbs and lenses that blur more in the corners, told and not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from tqdm import tqdm

from horizon.errors import FixErrors
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.sim.frame_truth import FrameTruth
from horizon_sensor_ros.sim.hard_scenes import HardScene, hard_scene
from tables import Options, Table

COLUMNS = (
    "scenes",
    "what",
    "told",
    "cameras",
    *FixErrors.COLUMNS,
)
_KINDS = ("clouds", "air")
_UNEVEN_M = (0.0, 300.0, 1000.0, 3000.0)
_OF_SCENES = 20  # scenes a row: one of so many hard ones
NOTES = (
    "Hard scenes of two kinds, with waves of 200 to 6000 km in the height of the visible limb, of "
    "so many metres (one sigma), as cloud tops make them; told: `limb_unevenness` is that. Soft "
    "corners: lenses of .5 to .7 px in the middle and .7 to 1.1 px in the corners; told: "
    "`camera_N.corner_blur`. Each pair, and each of its cameras by itself.",
    "nadir: angle to the true one, degrees. NEES: mean of the squared nadir error in the fit's own "
    "sigmas (2 is right); beyond 3 sigma: share of it above 11.8.",
)


@dataclass(frozen=True, eq=False)
class _Case:
    """One scene: its truth, and its frames with the sensor that they are for, not told and told."""

    truth: FrameTruth
    ways: dict[str, tuple[HorizonSensor, list[Frame]]]


def _uneven(kind: str, uneven_m: float, count: int, seed: int) -> Iterator[_Case]:
    """Scenes drawn with an uneven limb."""
    plain = HorizonSensor(HorizonConfig(tracking=False))
    told = HorizonSensor(HorizonConfig(tracking=False, limb_unevenness_m=uneven_m))
    for i in range(count):
        scene = hard_scene(kind, i, seed)
        world = replace(scene.scene, limb_uneven_m=uneven_m)
        drawn = scene.redrawn(world, np.random.default_rng(i))
        frames = [Frame(view, frame.image) for view, frame in zip(scene.views, drawn, strict=True)]
        yield _Case(scene.frames[0].truth, {"no": (plain, frames), "yes": (told, frames)})


def _soft_corners(count: int, seed: int) -> Iterator[_Case]:
    """Scenes seen by lenses that blur more in the corners."""
    sensor = HorizonSensor(HorizonConfig(tracking=False))
    for i in range(count):
        scene = hard_scene("soft_corners", i, seed)
        frames = [Frame(v, frame.image) for v, frame in zip(scene.views, scene.frames, strict=True)]
        ways = {"no": (sensor, frames), "yes": (sensor, _with_lenses(scene, frames))}
        yield _Case(scene.frames[0].truth, ways)


def _with_lenses(scene: HardScene, frames: list[Frame]) -> list[Frame]:
    """The frames by cameras whose lenses are told."""
    out = []
    for frame, imaging in zip(frames, scene.imaging, strict=True):
        view = replace(frame.view, corner_blur_px=imaging.corner_blur_px)
        out.append(replace(frame, view=view))
    return out


def run(options: Options) -> list[Table]:
    """One row a kind of scenes, whether it is told, and pairs or single cameras."""
    count = max(1, options.hard_scenes // _OF_SCENES)
    sets = [
        (kind, f"limb uneven by {uneven_m:.0f} m", _uneven(kind, uneven_m, count, options.seed))
        for kind in _KINDS
        for uneven_m in _UNEVEN_M
    ]
    sets.append(("clouds", "soft corners", _soft_corners(count, options.seed)))
    rows = []
    for kind, what, cases in sets:
        found = {(told, cameras): FixErrors() for told in ("no", "yes") for cameras in (2, 1)}
        for case in tqdm(cases, total=count, desc=f"{kind}, {what}", unit="scene"):
            for (told, cameras), row in found.items():
                sensor, frames = case.ways[told]
                for shown in [frames] if cameras == 2 else [[frame] for frame in frames]:
                    row.add(sensor, shown, case.truth)
        rows += [
            (kind, what, told, str(cameras), *row.cells()) for (told, cameras), row in found.items()
        ]
    return [Table(f"What is told ({count} scenes a row)", COLUMNS, tuple(rows), NOTES)]
