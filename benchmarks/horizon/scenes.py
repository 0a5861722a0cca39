"""The shared Earth scenes through `horizon_replay`, and the photographs from the ISS."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from horizon.bags import (
    CAMERAS,
    Fix,
    read_fixes,
    read_scenes,
    replay,
    write_parameters,
    write_scenes,
)
from horizon.errors import angle_deg, nadir_sigma_deg
from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from tables import Options, Table, Text, absent, number, percentile, shared_data, verdict

# Nadir's largest error by kind, deg. Those of the second line may also go without a fix.
BARS_DEG = {
    **dict.fromkeys(("flat", "clouds", "air", "dim", "sun", "moon", "boom", "lens", "high"), 0.04),
    **{"terminator": 0.1, "balloon": 0.1},
    "wgs84": 0.3,
}
MEDIAN_BAR_DEG = 0.01
MAY_REFUSE = ("terminator", "balloon")
NO_FIX = ("night",)
NO_FIX_ALONE = ("space", "earth", "night")

SENSOR_WIDTH_MM = 36.0
# Focal length, mm; of iss064e002941 from the EXIF of another public copy of the photograph: its own
# has only the lens, 17 to 35 mm.
PHOTOGRAPHS_MM = {
    "iss064_flickr50644513538.jpg": 56.0,
    "ISS028-E-33700.JPG": 15.0,
    "iss064e002941.jpg": 17.0,
    "iss028e031144.jpg": 22.0,
    "iss031e010712.jpg": 24.0,
    "iss044e045576.jpg": 28.0,
    "iss053e162584.jpg": 24.0,
    "iss071e319414.jpg": 50.0,
    "ISS028-E-33400.JPG": 15.0,
    "ISS028-E-33445.JPG": 15.0,
}
MUST_FIX = "iss064_flickr50644513538.jpg"
MUST_REFUSE = "ISS028-E-33700.JPG"
ISS_ALTITUDES_KM = (250.0, 600.0)


def run(_: Options) -> list[Table | Text]:
    """One row a scene, one row a photograph; or why not."""
    directory = shared_data()
    parts: list[Table | Text] = []
    for title, folder, make in (
        ("Shared Earth scenes", "earth_scenes", scenes_table),
        ("Photographs from the ISS", "earth_real", photographs_table),
    ):
        if directory is None or not (directory / folder).is_dir():
            parts.append(absent(title, folder))
        else:
            parts.append(make(directory / folder))
    return parts


# ---------------------------------------------------------------------------- drawn scenes


def scenes_table(directory: Path) -> Table:
    """Replay the scenes with both cameras and with camera 1 alone; a row a scene."""
    scenes = read_scenes(directory)
    with tempfile.TemporaryDirectory() as scratch:
        bag = Path(scratch, "scenes")
        write_scenes(bag, directory, scenes)
        both, said_both = _replayed(bag, CAMERAS)
        alone, said_alone = _replayed(bag, CAMERAS[:1])
    rows = [_scene_row(scene, both.get(i), alone.get(i)) for i, scene in enumerate(scenes)]
    errors = [
        angle_deg(both[i].nadir_base, np.array(scene["nadir_body"]))
        for i, scene in enumerate(scenes)
        if i in both
    ]
    return Table(
        "Shared Earth scenes, through horizon_replay",
        (
            "scene",
            "nadir, deg",
            "sigma, deg",
            "geodetic, deg",
            "altitude, km",
            "sigma, km",
            "bar, deg",
            "camera 1 alone",
            "bar",
        ),
        tuple(rows),
        (
            f"nadir: angle from true geocentric nadir, both cameras; median of the {len(errors)} "
            f"fixes {number(percentile(errors, 50), 4)}, "
            f"{verdict(percentile(errors, 50), MEDIAN_BAR_DEG)}. "
            "geodetic: from the ellipsoid's normal. "
            "altitude: estimate minus truth; of wgs84 the truth is above the ellipsoid, the "
            "estimate above a sphere of 6371 km. sigma: the message's own, of nadir in its least "
            "certain direction.",
            "camera 1 alone: nadir's error with only camera 1 in use.",
            f"horizon_replay, both cameras: {said_both}",
            f"horizon_replay, camera 1 alone: {said_alone}",
        ),
    )


def _replayed(bag: Path, cameras: Sequence[str]) -> tuple[dict[int, Fix], str]:
    name = f"{bag.name}_{len(cameras)}"
    parameters, out = bag.with_name(f"{name}.yaml"), bag.with_name(name)
    write_parameters(parameters, cameras)
    said = replay(bag, out, parameters)
    return read_fixes(out), said


def _scene_row(scene: dict[str, Any], both: Fix | None, alone: Fix | None) -> tuple[str, ...]:
    truth = np.array(scene["nadir_body"])
    kind = scene["kind"]
    bar_alone = ""
    if kind in NO_FIX_ALONE:
        bar_alone = "met (no fix)" if alone is None else "MISSED (no fix)"
    if both is None:
        figures = ("no fix", "-", "-", "-", "-")
        error = 0.0 if kind in MAY_REFUSE else np.nan
    else:
        error = angle_deg(both.nadir_base, truth)
        geodetic = scene["geodetic_nadir_body"]
        figures = (
            number(error, 4),
            number(both.nadir_sigma_deg, 4),
            "" if geodetic is None else number(angle_deg(both.nadir_base, np.array(geodetic)), 4),
            number(both.altitude_m / 1e3 - scene["altitude_km"], 2),
            number(both.altitude_sigma_m / 1e3, 2),
        )
    bar = ""
    if kind in NO_FIX:
        bar = "met (no fix)" if both is None else "MISSED (no fix)"
    elif kind in BARS_DEG:
        bar = verdict(error, BARS_DEG[kind])
    return (
        scene["name"],
        *figures,
        bar,
        "no fix" if alone is None else number(angle_deg(alone.nadir_base, truth), 4),
        bar_alone,
    )


# ---------------------------------------------------------------------------- photographs


def photographs_table(directory: Path) -> Table:
    """Look for the horizon in every photograph on its own."""
    rows = [
        _photograph_row(directory / name, focal_mm)
        for name, focal_mm in PHOTOGRAPHS_MM.items()
        if (directory / name).is_file()
    ]
    low, high = ISS_ALTITUDES_KM
    return Table(
        "Photographs from the ISS",
        (
            "photograph",
            "focal, mm",
            "altitude, km",
            "sigma, km",
            "nadir sigma, deg",
            "bar",
            "reason",
        ),
        tuple(rows),
        (
            f"One camera, no attitude truth; the station flies at 370 to 430 km. bar: {MUST_FIX} "
            f"fixed within {low:g} to {high:g} km, {MUST_REFUSE} refused; of the others a fix "
            "outside that range is marked WRONG. Focal lengths from EXIF on a sensor of "
            f"{SENSOR_WIDTH_MM:g} mm, not calibrated.",
        ),
    )


def _photograph_row(path: Path, focal_mm: float) -> tuple[str, ...]:
    gray = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if gray is None:
        raise FileNotFoundError(f"{path} is not a picture")
    height, width = gray.shape
    focal_px = focal_mm / SENSOR_WIDTH_MM * width
    camera = Camera(width, height, focal_px, focal_px, (width - 1) / 2.0, (height - 1) / 2.0)
    fix = HorizonSensor().process([Frame(CameraView("camera_1", camera, np.eye(3)), gray)])
    altitude_km = fix.fit.altitude_m / 1e3
    inside = ISS_ALTITUDES_KM[0] <= altitude_km <= ISS_ALTITUDES_KM[1]
    bar = "" if inside or not fix.ok else "WRONG"
    if path.name == MUST_FIX:
        bar = "met (fix)" if fix.ok and inside else "MISSED (fix)"
    elif path.name == MUST_REFUSE:
        bar = "MISSED (no fix)" if fix.ok else "met (no fix)"
    name, focal = path.name, number(focal_mm, 0)
    if not fix.ok:
        return (name, focal, "no fix", "-", "-", bar, fix.reason)
    cov = fix.fit.cov_nadir_altitude
    return (
        name,
        focal,
        number(altitude_km, 1),
        number(float(np.sqrt(cov[3, 3])) / 1e3, 1),
        number(nadir_sigma_deg(cov[:3, :3]), 3),
        bar,
        "",
    )
