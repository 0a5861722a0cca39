"""The camera and extrinsics file of `horizon_applicability` and `horizon_bag_from_images`.

`config/applicability_example.yaml` shows it.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.mathematics.attitude import rotation_from_quaternion
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.ros.files.yaml_file import YamlFileError, read_yaml, shown

_FILE_KEYS = ("cameras", "altitude_km", "nadir_at_zero", "planet")
_PLANET_KEYS = ("shape", "radius_km", "limb_height_km", "latitude_deg", "heading_deg")
_FOCAL_KEYS = ("fx", "fy", "cx", "cy")
_CAMERA_KEYS = (
    "width", "height", *_FOCAL_KEYS, "fov_deg", "fov_across", "model", "distortion", "rotation",
)  # fmt: skip


class CameraFileError(ValueError):
    """The file cannot be used; the message names the file, the key, and what to do."""


@dataclass(frozen=True, eq=False)
class Rig:
    """Cameras on a craft, and the planet below it.

    altitude_m : None when the file leaves it to the command line. nadir_at_zero : (3,) nadir in the
    base frame at zero roll, pitch and yaw. latitude_rad, heading_rad : see `horizon_rays`.
    """

    views: tuple[CameraView, ...]
    planet: Planet
    altitude_m: float | None
    nadir_at_zero: np.ndarray
    latitude_rad: float = 0.0
    heading_rad: float = 0.0


def read_camera_file(path: Path) -> Rig:
    """Read and check the file; CameraFileError for anything missing, unknown or impossible."""
    try:
        content = read_yaml(path)
    except YamlFileError as error:
        raise CameraFileError(f"{path}: {error}") from None
    root = _Section(path, "", content, _FILE_KEYS)
    cameras = root.get("cameras")
    if not isinstance(cameras, dict) or not cameras:
        raise root.error(
            "cameras", "must hold one block for each camera: cameras: {camera_1: {...}}"
        )
    planet = _Section(path, "planet", root.get("planet", {}), _PLANET_KEYS)
    altitude_km = root.get("altitude_km", None)
    return Rig(
        views=tuple(
            _camera(_Section(path, f"cameras.{name}", block, _CAMERA_KEYS), str(name))
            for name, block in cameras.items()
        ),
        planet=_planet(planet),
        altitude_m=None if altitude_km is None else 1e3 * root.number("altitude_km", above=0.0),
        nadir_at_zero=_nadir(root),
        latitude_rad=np.radians(planet.number("latitude_deg", 0.0)),
        heading_rad=np.radians(planet.number("heading_deg", 0.0)),
    )


def _planet(section: _Section) -> Planet:
    shape = section.choice("shape", "sphere", ("sphere", "wgs84"))
    limb_height_m = 1e3 * section.number("limb_height_km", 0.0)
    if shape == "wgs84" and section.get("radius_km", None) is not None:
        raise section.error("radius_km", "belongs to a sphere; remove it, or set shape: sphere")
    radius_m = 1e3 * section.number("radius_km", 6371.0, above=0.0)
    try:
        return Planet(radius_m, limb_height_m) if shape == "sphere" else Planet.wgs84(limb_height_m)
    except ValueError as error:
        raise section.error("limb_height_km", str(error)) from error


def _nadir(root: _Section) -> np.ndarray:
    nadir = root.numbers("nadir_at_zero", (3,), [0.0, 0.0, -1.0])
    length = float(np.linalg.norm(nadir))
    if length == 0:
        raise root.error("nadir_at_zero", "must not be zero; [0, 0, -1] is a level craft's, z up")
    return nadir / length


def _camera(section: _Section, name: str) -> CameraView:
    width = section.number("width", above=0.0)
    height = section.number("height", above=0.0)
    model = section.choice(
        "model", "plumb_bob", ("plumb_bob", "rational_polynomial", "equidistant")
    )
    focal_given = section.get("fx", None) is not None
    if focal_given == (section.get("fov_deg", None) is not None):
        raise section.error("fx, fov_deg", "give either fx (and fy, cx, cy) or fov_deg")
    if focal_given:
        fx = section.number("fx", above=0.0)
    else:
        fx = _focal_length(section, width, height, model)
    try:
        camera = Camera(
            width=width,  # type: ignore[arg-type]
            height=height,  # type: ignore[arg-type]
            fx=fx,
            fy=section.number("fy", fx, above=0.0),
            cx=section.number("cx", (width - 1) / 2),
            cy=section.number("cy", (height - 1) / 2),
            model=model,
            distortion=tuple(section.numbers("distortion", None, [])),
        )
    except ValueError as error:
        if isinstance(error, CameraFileError):
            raise
        raise section.error("", str(error)) from error
    try:
        rotation = rotation_from_quaternion(section.numbers("rotation", (4,)))
    except ValueError as error:
        if isinstance(error, CameraFileError):
            raise
        raise section.error(
            "rotation", f"{error}; give [x, y, z, w] from the optical frame to the base frame"
        ) from error
    return CameraView(name, camera, rotation)


def _focal_length(section: _Section, width: float, height: float, model: str) -> float:
    """Focal length (px) from the field of view, without distortion."""
    across = section.choice("fov_across", "horizontal", ("horizontal", "vertical", "diagonal"))
    size = {"horizontal": width, "vertical": height, "diagonal": float(np.hypot(width, height))}
    limit = 360.0 if model == "equidistant" else 180.0
    half = np.radians(section.number("fov_deg", above=0.0, below=limit)) / 2
    return float(size[across] / 2 / (half if model == "equidistant" else np.tan(half)))


class _Section:
    """One block of the file, which knows where it stands when something is wrong."""

    def __init__(self, path: Path, name: str, content: Any, known: Collection[str]) -> None:
        self._path, self._name = path, name
        if not isinstance(content, dict):
            raise self.error("", f"must be a block of keys ({', '.join(known)})")
        for key in content:
            if key not in known:
                near = difflib.get_close_matches(str(key), known, n=1)
                hint = f"; did you mean {near[0]}?" if near else f"; known are {', '.join(known)}"
                raise self.error(str(key), f"is not known{hint}")
        self._content = content

    def error(self, key: str, what: str) -> CameraFileError:
        place = ".".join(part for part in (self._name, key) if part)
        return CameraFileError(f"{self._path}: {place + ': ' if place else ''}{what}")

    def get(self, key: str, *default: Any) -> Any:
        if key in self._content:
            return self._content[key]
        if default:
            return default[0]
        raise self.error(key, "is missing; add it (config/applicability_example.yaml shows how)")

    def number(
        self, key: str, *default: float, above: float = -np.inf, below: float = np.inf
    ) -> float:
        value = self.get(key, *default)
        if not _is_number(value) or not above < value < below:
            wanted = "must be a number"
            if np.isfinite(above):
                wanted += f" above {above:g}"
            if np.isfinite(below):
                wanted += f" and below {below:g}"
            raise self.error(key, f"{wanted}, got {shown(value)}")
        return float(value)

    def numbers(self, key: str, shape: tuple[int] | None, *default: list[float]) -> np.ndarray:
        value = self.get(key, *default)
        if (
            not isinstance(value, list)
            or not all(_is_number(item) for item in value)
            or (shape is not None and len(value) != shape[0])
        ):
            count = f"{shape[0]} numbers" if shape else "numbers"
            raise self.error(key, f"must be a list of {count}, got {shown(value)}")
        return np.array(value, dtype=float)

    def choice(self, key: str, default: str, allowed: Collection[str]) -> str:
        value = self.get(key, default)
        if value not in allowed:
            raise self.error(key, f"must be one of {', '.join(allowed)}, got {shown(value)}")
        return str(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
