"""Parameters of what helps the horizon: coarse pose, known altitude, angular rate."""

from __future__ import annotations

from horizon_sensor_ros.core.aiding import CoarsePose
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.ros.parameters.parameter import Parameter

AIDING_PARAMETERS = (
    Parameter(
        "coarse_pose_max_age",
        "double",
        60.0,
        "A coarse pose farther off in time than this, before or after, by its stamp and the "
        "image's, is not used. What the craft may have flown and turned by between the two is "
        "claimed.",
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
)
