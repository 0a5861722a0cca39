"""The true planet: WGS84 scenes fitted as a sphere, and as the ellipsoid with a coarse pose."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from horizon.bags import Fix, read_fixes, read_scenes, replay, write_parameters, write_scenes
from horizon.errors import BEYOND_NEES, FitErrors, angle_deg, fit_errors
from horizon_sensor_ros.core.aiding import Aiding, CoarsePose
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.mathematics.rigid import rotation_from_vector
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.planet_figure import VERTICALS
from horizon_sensor_ros.sim.frame_truth import FrameTruth
from horizon_sensor_ros.sim.scene_sets import two_camera_set
from tables import Options, Table, Text, absent, number, percentile, shared_data, verdict

WGS84 = Planet.wgs84()
# One sigma of position and attitude, each axis, and how the row is called; None: no pose.
POSES = (
    ("none: the mean sphere", None),
    ("as coarse as allowed: 50 km, 10 deg", (50e3, np.radians(10.0))),
    ("5 km, 1 deg", (5e3, np.radians(1.0))),
)
BAR_DEG = 0.02
_SHARED_TITLE = "The shared ellipsoid, through horizon_replay"
_SHARE = 4  # of the frames a set: each scene is fitted six times
COLUMNS = (
    "coarse pose",
    "vertical",
    "fixed",
    "median, deg",
    "RMS",
    "max",
    "NEES",
    "over 3 sigma",
    "altitude RMS, m",
    "bar of the median",
)


def run(options: Options) -> list[Table | Text]:
    """One row a pose and vertical, of our own scenes and of the shared one."""
    directory = shared_data()
    if directory is None or not (directory / "earth_scenes").is_dir():
        shared: Table | Text = absent(_SHARED_TITLE, "earth_scenes")
    else:
        shared = shared_table(directory / "earth_scenes")
    return [drawn_table(options), shared]


def drawn_table(options: Options) -> Table:
    """Own scenes: errors and whether the covariance holds, with poses as coarse as may be."""
    count = max(1, options.frames // _SHARE)
    rng = np.random.default_rng([options.seed, 84])
    kinds = [(name, sigmas, vertical) for name, sigmas in POSES for vertical in VERTICALS]
    errors: dict[tuple[str, str], list[FitErrors]] = {(n, v): [] for n, _, v in kinds}
    altitudes: dict[tuple[str, str], list[float]] = {key: [] for key in errors}
    scenes = two_camera_set(count, options.seed, WGS84)
    for case in tqdm(scenes, total=count, desc="WGS84", unit="scene"):
        truth = case.frames[0].truth
        frames = [Frame(v, f.image) for v, f in zip(case.views, case.frames, strict=True)]
        aiding = {name: Aiding(_coarse(truth, sigmas, rng)) for name, sigmas in POSES}
        for name, _, vertical in kinds:
            sensor = HorizonSensor(HorizonConfig(planet=WGS84, vertical=vertical))
            fix = sensor.process(frames, aiding[name])
            if not fix.ok:
                continue
            geodetic = vertical == "geodetic"
            nadir = truth.geodetic_nadir_base if geodetic else truth.nadir_base
            errors[name, vertical].append(fit_errors(fix.fit, nadir, truth.altitude_m))
            altitudes[name, vertical].append(fix.fit.altitude_m - truth.altitude_m)
    rows = [
        _row(name, vertical, errors[name, vertical], altitudes[name, vertical], sigmas is not None)
        for name, sigmas, vertical in kinds
    ]
    notes = (
        "Two perpendicular cameras, clouds and noise as in set B, 300 to 6000 km above the "
        "ellipsoid, any place, any attitude. The pose's errors are drawn with the sigmas that the "
        "sensor is told.",
        "nadir against the vertical that was asked for; altitude above the ellipsoid; NEES: 2 is "
        "right. bar: of the median.",
    )
    return Table(f"The true planet ({count} scenes)", COLUMNS, tuple(rows), notes)


def shared_table(directory: Path) -> Table:
    """Replay the shared scene of an ellipsoid with and without its position."""
    scenes = [scene for scene in read_scenes(directory) if scene["kind"] == "wgs84"]
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        bag = Path(scratch, "scenes")
        write_scenes(bag, directory, scenes)
        for posed, remap in ((True, ()), (False, ("--remap", "coarse_pose:=nowhere"))):
            for vertical in VERTICALS:
                out = Path(scratch, f"{vertical}_{posed}")
                write_parameters(out.with_suffix(".yaml"), planet="wgs84", vertical=vertical)
                replay(bag, out, out.with_suffix(".yaml"), *remap)
                fixes = read_fixes(out)
                rows += [
                    _shared_row(scene, vertical, fixes.get(i), posed)
                    for i, scene in enumerate(scenes)
                ]
    notes = (
        "Both cameras. With its position: the true one, told to be good to 50 km and 10 deg. "
        "nadir against the vertical asked for; altitude above the ellipsoid.",
    )
    columns = ("scene", "position", "vertical", "nadir, deg", "sigma", "altitude, km", "bar")
    return Table(_SHARED_TITLE, columns, tuple(rows), notes)


def _shared_row(
    scene: dict[str, Any], vertical: str, fix: Fix | None, posed: bool
) -> tuple[str, ...]:
    place = (scene["name"], "known" if posed else "none", vertical)
    if fix is None:
        return (*place, "no fix", "-", "-", "MISSED" if posed else "")
    key = "geodetic_nadir_body" if vertical == "geodetic" else "nadir_body"
    error = angle_deg(fix.nadir_base, np.array(scene[key]))
    height = WGS84.geodetic_from_ecef(np.array(scene["position_ecef_km"]) * 1e3)[2]
    return (
        *place,
        number(error, 4),
        number(fix.nadir_sigma_deg, 4),
        number((fix.altitude_m - height) / 1e3, 2),
        verdict(error, BAR_DEG) if posed else "",
    )


def _coarse(
    truth: FrameTruth, sigmas: tuple[float, float] | None, rng: np.random.Generator
) -> CoarsePose | None:
    position_off, turn = rng.normal(size=(2, 3))
    if sigmas is None:
        return None
    off = rotation_from_vector(turn * sigmas[1])
    position = truth.position_ecef_m + position_off * sigmas[0]
    return CoarsePose(position, truth.rot_world_from_base @ off, *sigmas)


def _row(
    name: str, vertical: str, errors: Sequence[FitErrors], altitudes: Sequence[float], posed: bool
) -> tuple[str, ...]:
    nadir = np.array([e.nadir_deg for e in errors])
    nees = np.array([e.nees for e in errors])
    median = percentile(nadir, 50)
    return (
        name,
        vertical,
        str(len(errors)),
        number(median, 4),
        number(float(np.sqrt(np.mean(nadir**2))) if len(nadir) else np.nan, 4),
        number(percentile(nadir, 100), 4),
        number(float(nees.mean()) if len(nees) else np.nan, 2),
        # Of two degrees of freedom, with the normal law's share for 3 sigma of one.
        str(int(np.count_nonzero(nees > BEYOND_NEES))),
        number(float(np.sqrt(np.mean(np.square(altitudes)))) if len(altitudes) else np.nan, 0),
        verdict(median, BAR_DEG) if posed else "",
    )
