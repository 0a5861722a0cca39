"""Parameters that each camera has, `camera_1.rotation` and the like."""

from __future__ import annotations

from horizon_sensor_ros.ros.parameters.parameter import Parameter


def rotation_parameter(camera: str) -> Parameter:
    """Return the parameter that says how a camera sits in the base frame."""
    return Parameter(
        f"{camera}.rotation",
        "double_array",
        None,
        "Quaternion x, y, z, w: takes a vector from the camera's optical frame (x right, y down, "
        "z forward) to the base frame.",
    )


def mask_parameter(camera: str) -> Parameter:
    """Return the parameter that says which part of a camera's image may be used."""
    return Parameter(
        f"{camera}.mask",
        "string",
        "",
        "Picture (PNG) of the size of the camera's images: white where they may be used, black "
        "where the craft itself is. An absolute path or package://PACKAGE/PATH; empty: no mask.",
    )


def gamma_parameter(camera: str) -> Parameter:
    """Return the parameter that says how a camera encodes light in its images."""
    return Parameter(
        f"{camera}.gamma",
        "double",
        1.0,
        "How the camera encodes light: pixel values go with its power 1 / gamma. 1: they are in "
        "proportion; about 2.2: photographs, video and most cameras' JPEG.",
        minimum=0.2,
        maximum=5.0,
    )


def readout_parameter(camera: str) -> Parameter:
    """Return the parameter that says how long a camera's rolling shutter takes."""
    return Parameter(
        f"{camera}.readout",
        "double",
        0.0,
        "Rolling shutter: time from the first row of an image to the last, negative where the last "
        "one is read first (a picture turned upside down). The stamp is that of the row that is "
        "read first. 0: a global shutter.",
        unit="s",
        minimum=-1.0,
        maximum=1.0,
    )


def exposure_parameter(camera: str) -> Parameter:
    """Return the parameter that says how long a camera exposes its images."""
    return Parameter(
        f"{camera}.exposure",
        "double",
        0.0,
        "How long an image is exposed, about its stamp, where that does not change: with the rate "
        "by imu, or by the fixes before, it tells how motion smears the limb. 0: not known.",
        unit="s",
        minimum=0.0,
        maximum=10.0,
    )


def corner_blur_parameter(camera: str) -> Parameter:
    """Return the parameter that says how much more a camera's lens blurs in the corners."""
    return Parameter(
        f"{camera}.corner_blur",
        "double",
        -1.0,
        "One sigma of an edge's blur in the corners of the camera's images, less that in the "
        "middle, as slanted edges show it or horizon_self_calibration finds it. Below 0: not "
        "known.",
        unit="px",
        minimum=-1.0,
        maximum=5.0,
    )


OF_A_CAMERA = (
    rotation_parameter,
    mask_parameter,
    gamma_parameter,
    readout_parameter,
    exposure_parameter,
    corner_blur_parameter,
)
