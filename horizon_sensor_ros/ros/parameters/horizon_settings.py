"""Values of the horizon's parameters -> validated settings."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.mathematics.attitude import rotation_from_quaternion
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.seconds import ns_from_s
from horizon_sensor_ros.ros.files.resources import read_mask, resource_path
from horizon_sensor_ros.ros.files.yaml_file import shown
from horizon_sensor_ros.ros.parameters.camera import (
    corner_blur_parameter,
    exposure_parameter,
    gamma_parameter,
    mask_parameter,
    readout_parameter,
    rotation_parameter,
)
from horizon_sensor_ros.ros.parameters.common import COMMON_PARAMETERS
from horizon_sensor_ros.ros.parameters.frame_name import frame_problems
from horizon_sensor_ros.ros.parameters.horizon import CAMERAS, HORIZON_PARAMETERS
from horizon_sensor_ros.ros.parameters.parameter import (
    Parameter,
    ParameterError,
    accept_all,
    with_parameter_names,
)

_CAMERA_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_EARTHS_RADII_M = 6.35e6, 6.39e6  # polar to equatorial, and some more

# Parameters that go into the core's configuration as they are.
_SENSOR_FIELDS = {
    "method": "method",
    "limb": "limb",
    "vertical": "vertical",
    "altitude_min": "altitude_min_m",
    "altitude_max": "altitude_max_m",
    "max_nadir_sigma": "max_nadir_sigma_rad",
    "max_residual": "max_residual_px",
    "min_limb_share": "min_limb_share",
    "max_bright_sky": "max_bright_sky",
    "min_clear_sky": "min_clear_sky",
    "min_contrast": "min_contrast",
    "max_space_level": "max_space_level",
    "mounting_sigma": "mounting_sigma_rad",
    "lens_sigma": "lens_sigma_px",
    "limb_height_sigma": "limb_height_sigma_m",
    "limb_unevenness": "limb_unevenness_m",
    "rate_sigma": "rate_sigma_rad_s",
    "tracking": "tracking",
}


@dataclass(frozen=True)
class AidingSettings:
    """What is done with coarse_pose, imu and a known altitude; a sigma of 0: there is none."""

    max_age_ns: int
    position_sigma_m: float
    rotation_sigma_rad: float
    pose_altitude_sigma_m: float
    altitude_m: float
    altitude_sigma_m: float
    imu_max_gap_ns: int


@dataclass(frozen=True)
class CameraSettings:
    """What is told of a camera.

    rotation : quaternion (x, y, z, w), optical to base frame; None: from TF. mask : its file; None:
    it has no mask. gamma : the encoding of its light. readout_s, exposure_s,
    corner_blur_px : see `CameraView`.
    """

    name: str
    rotation: tuple[float, ...] | None
    mask: Path | None
    gamma: float
    readout_s: float
    exposure_s: float
    corner_blur_px: float | None


@dataclass(frozen=True)
class PipelineSettings:
    """Everything that the estimates of the horizon depend on. each : of the cameras in use."""

    each: tuple[CameraSettings, ...]
    aiding: AidingSettings
    base_frame: str
    sensor: HorizonConfig
    slop_ns: int
    camera_timeout_ns: int
    queue_size: int

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras."""
        return tuple(camera.name for camera in self.each)

    @property
    def rotations(self) -> tuple[tuple[float, ...] | None, ...]:
        """Their rotations."""
        return tuple(camera.rotation for camera in self.each)


@dataclass(frozen=True)
class HorizonSettings:
    """Settings of a horizon node, or of its part in a replay."""

    pipeline: PipelineSettings
    level_z: str
    stale_after_ns: int
    diagnostics_period_s: float


def horizon_settings(values: Mapping[str, Any]) -> HorizonSettings:
    """Return validated settings of parameter values; what is not given has its default.

    Raises ParameterError with everything that is wrong, in one line.
    """
    accepted, problems = accept_all((*HORIZON_PARAMETERS, *COMMON_PARAMETERS), values)
    each: list[CameraSettings] = []
    problems += frame_problems("base_frame", accepted)
    cameras = accepted.get("cameras", [])
    problems += _camera_name_problems(cameras) if "cameras" in accepted else []
    for camera in filter(_CAMERA_NAME.fullmatch, dict.fromkeys(cameras)):
        try:
            each.append(_camera_settings(camera, values, accepted.get("extrinsics_source") == "tf"))
        except ParameterError as error:
            problems.append(str(error))
    if problems:
        raise ParameterError("; ".join(problems))
    sensor = _sensor_config(accepted)
    return HorizonSettings(
        pipeline=PipelineSettings(
            each=tuple(each),
            aiding=AidingSettings(
                max_age_ns=ns_from_s(accepted["coarse_pose_max_age"]),
                position_sigma_m=accepted["coarse_pose_position_sigma"],
                rotation_sigma_rad=accepted["coarse_pose_rotation_sigma"],
                pose_altitude_sigma_m=accepted["coarse_pose_altitude_sigma"],
                altitude_m=accepted["altitude_prior"],
                altitude_sigma_m=accepted["altitude_prior_sigma"],
                imu_max_gap_ns=ns_from_s(accepted["imu_max_gap"]),
            ),
            base_frame=accepted["base_frame"],
            sensor=sensor,
            slop_ns=ns_from_s(accepted["slop"]),
            camera_timeout_ns=ns_from_s(accepted["camera_timeout"]),
            queue_size=accepted["queue_size"],
        ),
        level_z=accepted["level_z"],
        stale_after_ns=ns_from_s(accepted["stale_after"]),
        diagnostics_period_s=accepted["diagnostics_period"],
    )


def cameras_of(values: Mapping[str, Any]) -> list[str]:
    """Return the cameras that a horizon node uses; ParameterError when they cannot be."""
    accepted, problems = accept_all((CAMERAS,), values)
    problems += _camera_name_problems(accepted["cameras"]) if accepted else []
    if problems:
        raise ParameterError("; ".join(problems))
    return accepted["cameras"]


def _sensor_config(values: Mapping[str, Any]) -> HorizonConfig:
    limb_height = values["limb_height"]
    wgs84 = values["planet"] == "wgs84"
    if wgs84 and not values["planet_air"]:
        raise ParameterError("planet_air is false, but planet is wgs84: the Earth has air")
    low_m, high_m = _EARTHS_RADII_M
    if wgs84 and not low_m <= values["planet_radius"] <= high_m:
        raise ParameterError(
            f"planet_radius is {values['planet_radius']:.0f} m, but planet is wgs84, the Earth's "
            "figure: another body is a sphere"
        )
    try:
        if wgs84:
            planet = Planet.wgs84(limb_height)
        else:
            radius = values["planet_radius"]
            planet = Planet(radius, limb_height, has_air=values["planet_air"])
        return HorizonConfig(
            planet=planet,
            **{field: values[name] for name, field in _SENSOR_FIELDS.items()},
        )
    except ValueError as error:
        fields = {"planet_radius": "radius_m", "limb_height": "limb_height_m", **_SENSOR_FIELDS}
        raise ParameterError(with_parameter_names(str(error), fields)) from None


def _camera_name_problems(cameras: Sequence[str]) -> list[str]:
    problems = []
    if not cameras:
        problems.append("cameras is empty: a horizon sensor needs at least one")
    if len(set(cameras)) != len(cameras):
        problems.append(f"cameras names one twice: {', '.join(cameras)}")
    problems += [
        f"cameras has {shown(name)}: a camera's name is of letters, digits and _, a letter first; "
        "remap image_raw and camera_info of one that publishes elsewhere"
        for name in cameras
        if not _CAMERA_NAME.fullmatch(name)
    ]
    return problems


def _camera_settings(camera: str, values: Mapping[str, Any], from_tf: bool) -> CameraSettings:
    """Raises ParameterError with all that is wrong with a camera's parameters."""
    accepted: dict[str, Any] = {}
    problems = []
    plain = (gamma_parameter, readout_parameter, exposure_parameter, corner_blur_parameter)
    ways: dict[str, Callable[[], Any]] = {
        "mask": partial(_mask, camera, values),
        **{of(camera).name: partial(_number, of(camera), values) for of in plain},
        "rotation": partial(_rotation, camera, values),
    }
    if from_tf:
        ways["rotation"] = lambda: None
    for name, way in ways.items():
        try:
            accepted[name.rpartition(".")[2]] = way()
        except ParameterError as error:
            problems.append(str(error))
    if problems:
        raise ParameterError("; ".join(problems))
    blur_px = accepted["corner_blur"]
    return CameraSettings(
        camera,
        accepted["rotation"],
        accepted["mask"],
        accepted["gamma"],
        accepted["readout"],
        accepted["exposure"],
        blur_px if blur_px >= 0.0 else None,
    )


def _number(parameter: Parameter, values: Mapping[str, Any]) -> float:
    return float(parameter.accept(values.get(parameter.name, parameter.default)))  # type: ignore[arg-type]


def _rotation(camera: str, values: Mapping[str, Any]) -> tuple[float, ...]:
    parameter = rotation_parameter(camera)
    value = values.get(parameter.name)
    if value is None:
        raise ParameterError(
            f"{parameter.name} is not set: {camera} is used and needs its rotation, a quaternion "
            "[x, y, z, w] from the optical to the base frame (there is no "
            "default; a parameter file has it under /** or the node's own name)"
        )
    quaternion = parameter.accept(value)
    try:
        rotation_from_quaternion(np.array(quaternion))
    except ValueError as error:
        raise ParameterError(f"{parameter.name}: {error}") from None
    return tuple(quaternion)  # type: ignore[arg-type]


def _mask(camera: str, values: Mapping[str, Any]) -> Path | None:
    parameter = mask_parameter(camera)
    given = parameter.accept(values.get(parameter.name, parameter.default))
    if not given:
        return None
    try:
        path = resource_path(str(given))
        read_mask(path)
    except ValueError as error:
        raise ParameterError(f"{parameter.name}: {error}") from None
    return path
