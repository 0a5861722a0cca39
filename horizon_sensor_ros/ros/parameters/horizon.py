"""Parameters of the horizon's nodes: planet, cameras' errors, fit, sets of frames; `aiding` and
`judgement` among them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from horizon_sensor_ros.core.fits import METHODS
from horizon_sensor_ros.core.horizon.config import LIMB_SOURCES, HorizonConfig
from horizon_sensor_ros.core.planet_figure import VERTICALS
from horizon_sensor_ros.ros.parameters.aiding import AIDING_PARAMETERS
from horizon_sensor_ros.ros.parameters.camera import OF_A_CAMERA
from horizon_sensor_ros.ros.parameters.common import COMMON_PARAMETERS, NODE_PARAMETERS
from horizon_sensor_ros.ros.parameters.judgement import JUDGEMENT_PARAMETERS
from horizon_sensor_ros.ros.parameters.parameter import Parameter, ParameterError

CAMERAS = Parameter(
    "cameras",
    "string_array",
    ["camera_1", "camera_2"],
    "Cameras to use, one or more; each has the topics <camera>/image_raw and <camera>/camera_info.",
)

BASE_FRAME = Parameter("base_frame", "string", "base_link", "Frame of the craft's body.")

SLOP = Parameter(
    "slop",
    "double",
    0.02,
    "Frames whose stamps differ by at most this make a set.",
    unit="s",
    minimum=0.0,
    maximum=10.0,
    live=True,
)

CAMERA_TIMEOUT = Parameter(
    "camera_timeout",
    "double",
    5.0,
    "A camera without a usable frame for longer than this, by the others' stamps, is left out, "
    "and the fixes come from the others, until it is back; 0: they wait for it.",
    unit="s",
    minimum=0.0,
    maximum=3600.0,
)

HORIZON_PARAMETERS = (
    CAMERAS,
    Parameter(
        "extrinsics_source",
        "string",
        "parameters",
        "Where the cameras' rotations come from: the parameters <camera>.rotation, or TF.",
        choices=("parameters", "tf"),
    ),
    BASE_FRAME,
    Parameter(
        "level_z",
        "string",
        "up",
        "Direction of the z axis of the frame local_level: up (away from the planet, REP 103) or "
        "down.",
        choices=("up", "down"),
    ),
    Parameter(
        "planet",
        "string",
        "sphere",
        "Figure of the planet. wgs84 needs a coarse pose; without one a sphere of the ellipsoid's "
        "mean radius is used.",
        choices=("sphere", "wgs84"),
    ),
    Parameter(
        "planet_radius",
        "double",
        6371000.0,
        "Radius of the planet where it is a sphere.",
        unit="m",
        minimum=1.0,
        maximum=1e9,
    ),
    Parameter(
        "planet_air",
        "bool",
        True,
        "Whether the planet has air that may hide its ground, lift its limb or glow; false around "
        "the Moon. What is not seen of it is claimed as if it were the Earth's.",
    ),
    Parameter(
        "limb_height",
        "double",
        0.0,
        "Height of the visible limb (air, cloud) above the surface.",
        unit="m",
        minimum=-1e5,
        maximum=1e6,
    ),
    Parameter(
        "limb_height_sigma",
        "double",
        HorizonConfig.limb_height_sigma_m,
        "One sigma of limb_height, for the covariance.",
        unit="m",
        minimum=0.0,
        maximum=1e6,
    ),
    Parameter(
        "limb_unevenness",
        "double",
        HorizonConfig.limb_unevenness_m,
        "One sigma of what the visible limb's height differs by from place to place (cloud tops), "
        "over some 500 km, for the covariance. 0: even, which the Earth's is not.",
        unit="m",
        minimum=0.0,
        maximum=1e6,
    ),
    Parameter(
        "mounting_sigma",
        "double",
        HorizonConfig.mounting_sigma_rad,
        "One sigma of each camera's rotation, about every axis, for the covariance.",
        unit="rad",
        minimum=0.0,
        maximum=0.5,
    ),
    Parameter(
        "lens_sigma",
        "double",
        HorizonConfig.lens_sigma_px,
        "One sigma of each camera's calibration, for the covariance: by how many pixels focal "
        "length or distortion may be off in the corners of its frames.",
        unit="px",
        minimum=0.0,
        maximum=1000.0,
    ),
    Parameter(
        "vertical",
        "string",
        "geocentric",
        "Which vertical is published: towards the planet's centre, or normal to the ellipsoid "
        "(needs a coarse pose; on a sphere the two are one).",
        choices=VERTICALS,
    ),
    *AIDING_PARAMETERS,
    Parameter(
        "method",
        "string",
        HorizonConfig.method,
        "How the horizon is fitted.",
        choices=tuple(METHODS),
    ),
    Parameter(
        "limb",
        "string",
        HorizonConfig.limb,
        "How precisely the limb is located: along its normal, or at Canny's whole pixels.",
        choices=LIMB_SOURCES,
    ),
    *JUDGEMENT_PARAMETERS,
    Parameter(
        "tracking",
        "bool",
        HorizonConfig.tracking,
        "Look for the limb where the last fix predicts it; search whole frames where that fails.",
        live=True,
    ),
    SLOP,
    CAMERA_TIMEOUT,
    Parameter(
        "queue_size",
        "integer",
        10,
        "How many frames of a camera wait for the other cameras'.",
        minimum=2,
        maximum=100,
    ),
)


def horizon_parameters(values: Mapping[str, Any]) -> tuple[Parameter, ...]:
    """Return all parameters of a horizon node with these values: some depend on `cameras`."""
    try:
        cameras: Any = CAMERAS.accept(values.get(CAMERAS.name, CAMERAS.default))
    except ParameterError:
        cameras = []
    each = [of(name) for name in dict.fromkeys(cameras) for of in OF_A_CAMERA]
    return (CAMERAS, *each, *HORIZON_PARAMETERS[1:], *COMMON_PARAMETERS, *NODE_PARAMETERS)
