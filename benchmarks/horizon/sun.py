"""The Sun without a planet: how often one camera takes it for one, and from how far away."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from tqdm import tqdm

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.sim.poses import camera_from_fov
from horizon_sensor_ros.sim.sun_alone import sun_alone
from tables import Options, Table, number, percentile

COLUMNS = ("the Sun with", "frames", "fixed", "nearest, km", "median, km")
NOTES = (
    "Frames of 640 x 480, 60 deg across, of nothing but the Sun, in the frame or up to 60 px "
    "beside it: overexposed, with halo, rays, blur, noise and JPEG; every fix is wrong.",
    "nearest, median: altitudes of those fixes; a limit below the nearest (altitude_max) rules "
    "them out.",
)


def _row(name: str, altitudes_km: Sequence[float]) -> tuple[str, ...]:
    fixed = [altitude for altitude in altitudes_km if np.isfinite(altitude)]
    return (
        name,
        str(len(altitudes_km)),
        str(len(fixed)),
        number(percentile(fixed, 0), 0),
        number(percentile(fixed, 50), 0),
    )


def run(options: Options) -> list[Table]:
    """Twice as many frames as hard scenes."""
    view = CameraView("camera_1", camera_from_fov(640, 480, np.radians(60.0)), np.eye(3))
    sensor, n = HorizonSensor(), 2 * options.hard_scenes
    of: dict[str, list[float]] = {"": [], "a ring": [], "a ghost": [], "a ring and a ghost": []}
    for i in tqdm(range(n), desc="The Sun alone", unit="frame"):
        drawn = sun_alone(640, 480, np.random.default_rng([options.seed, i]))
        sensor.reset()
        fix = sensor.process([Frame(view, drawn.image)])
        has = [name for name, there in (("ring", drawn.ring), ("ghost", drawn.ghost)) if there]
        of[" and ".join(f"a {name}" for name in has)].append(fix.fit.altitude_m / 1e3)
    rows = [_row(name or "halo and rays", altitudes) for name, altitudes in of.items()]
    rows.append(_row("all", [altitude for each in of.values() for altitude in each]))
    return [Table(f"The Sun without a planet ({n})", COLUMNS, tuple(rows), NOTES)]
