"""The true planet: WGS84 scenes fitted as a sphere, and as the ellipsoid with a coarse pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from horizon_errors import FitErrors, fit_errors
from tables import Options, Table, number, percentile, verdict
from tqdm import tqdm

from horizon_sensor_ros.core.aiding import Aiding, CoarsePose
from horizon_sensor_ros.core.figure import VERTICALS
from horizon_sensor_ros.core.horizon_sensor import Frame, HorizonConfig, HorizonSensor
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.target.rigid import rotation_from_vector
from horizon_sensor_ros.sim.frame_truth import FrameTruth
from horizon_sensor_ros.sim.scene_sets import two_camera_set

WGS84 = Planet.wgs84()
# One sigma of position and attitude, each axis, and how the row is called; None: no pose.
POSES = (
    ("none: the mean sphere", None),
    ("as coarse as allowed: 50 km, 10 deg", (50e3, np.radians(10.0))),
    ("5 km, 1 deg", (5e3, np.radians(1.0))),
)
BAR_DEG = 0.02
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


def run(options: Options) -> list[Table]:
    """One row a pose and vertical."""
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
    return [Table(f"The true planet ({count} scenes)", COLUMNS, tuple(rows), notes)]


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
        str(int(np.count_nonzero(nees > 11.83))),
        number(float(np.sqrt(np.mean(np.square(altitudes)))) if len(altitudes) else np.nan, 0),
        verdict(median, BAR_DEG) if posed else "",
    )
