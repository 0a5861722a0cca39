"""Parameters of the horizon's nodes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from horizon_sensor_ros.core.aiding import CoarsePose
from horizon_sensor_ros.core.fits import METHODS
from horizon_sensor_ros.core.horizon.config import LIMB_SOURCES, HorizonConfig
from horizon_sensor_ros.core.planet_figure import VERTICALS
from horizon_sensor_ros.ros.parameters.camera import OF_A_CAMERA
from horizon_sensor_ros.ros.parameters.common import COMMON_PARAMETERS, NODE_PARAMETERS
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
    Parameter(
        "coarse_pose_max_age",
        "double",
        60.0,
        "A coarse pose older than this, by its stamp and the image's, is not used. What the craft "
        "may have flown and turned by until then is claimed.",
        unit="s",
        minimum=0.0,
        maximum=1e6,
    ),
    Parameter(
        "coarse_pose_position_sigma",
        "double",
        CoarsePose.position_sigma_m,
        "One sigma of the coarse pose's position at its stamp, along each axis.",
        unit="m",
        minimum=0.0,
        maximum=1e7,
    ),
    Parameter(
        "coarse_pose_rotation_sigma",
        "double",
        CoarsePose.rotation_sigma_rad,
        "One sigma of the coarse pose's orientation at its stamp, about each axis.",
        unit="rad",
        minimum=0.0,
        maximum=3.2,
    ),
    Parameter(
        "coarse_pose_altitude_sigma",
        "double",
        0.0,
        "Where positive, the coarse pose's altitude is a measurement with this sigma at its stamp, "
        "and goes before altitude_prior; what an orbit may have risen or sunk by since is claimed. "
        "0: it is not used.",
        unit="m",
        minimum=0.0,
        maximum=1e9,
    ),
    Parameter(
        "altitude_prior",
        "double",
        0.0,
        "Known altitude above the planet's surface; a measurement with the sigma that follows.",
        unit="m",
        minimum=0.0,
        maximum=1e12,
    ),
    Parameter(
        "altitude_prior_sigma",
        "double",
        0.0,
        "One sigma of altitude_prior; 0: the altitude is not known.",
        unit="m",
        minimum=0.0,
        maximum=1e12,
    ),
    Parameter(
        "imu_max_gap",
        "double",
        0.2,
        "Rates of the topic imu farther apart than this are not integrated.",
        unit="s",
        minimum=0.0001,
        maximum=10.0,
    ),
    Parameter(
        "rate_sigma",
        "double",
        HorizonConfig.rate_sigma_rad_s,
        "One sigma of the craft's angular rate, about every axis, where neither imu nor the fixes "
        "before tell it: for the covariance of frames that are not of one moment, and, without "
        "imu, of a coarse pose's heading by its age.",
        unit="rad/s",
        minimum=0.0,
        maximum=10.0,
    ),
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
    Parameter(
        "altitude_min",
        "double",
        HorizonConfig.altitude_min_m,
        "A fit with a lower altitude is refused.",
        unit="m",
        minimum=1.0,
        maximum=1e12,
        live=True,
    ),
    Parameter(
        "altitude_max",
        "double",
        HorizonConfig.altitude_max_m,
        "A fit with a higher altitude is refused.",
        unit="m",
        minimum=1.0,
        maximum=1e12,
        live=True,
    ),
    Parameter(
        "max_nadir_sigma",
        "double",
        HorizonConfig.max_nadir_sigma_rad,
        "An estimate less certain than this is withheld.",
        unit="rad",
        minimum=1e-06,
        maximum=3.2,
        live=True,
    ),
    Parameter(
        "max_residual",
        "double",
        HorizonConfig.max_residual_px,
        "A limb that scatters more than this about the fit, per 640 pixels of image "
        "width, is refused.",
        unit="px",
        minimum=0.001,
        maximum=1000.0,
        live=True,
    ),
    Parameter(
        "min_limb_share",
        "double",
        HorizonConfig.min_limb_share,
        "Least share of the lit limb in a frame that must be found.",
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
    Parameter(
        "max_bright_sky",
        "double",
        HorizonConfig.max_bright_sky,
        "Largest share of the limb beside which the sky may be bright.",
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
    Parameter(
        "min_clear_sky",
        "double",
        HorizonConfig.min_clear_sky,
        "Least share of the sky that must be at the level of space.",
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
    Parameter(
        "min_contrast",
        "double",
        HorizonConfig.min_contrast,
        "Least step from planet to space beside the limb, in sigmas of the image's noise.",
        minimum=0.001,
        maximum=10000.0,
        live=True,
    ),
    Parameter(
        "max_space_level",
        "double",
        HorizonConfig.max_space_level,
        "Highest gray level of empty space, over the largest gray level: 255, or for 16-bit images "
        "that of the fewest bits, 8 or more, that hold the frame's brightest pixel (a 12-bit "
        "camera's is 4095 as soon as a pixel reaches 2048).",
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
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
