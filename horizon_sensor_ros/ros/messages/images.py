"""Images to gray levels."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from horizon_sensor_ros.core.cameras.byte_order import bytes_swapped
from horizon_sensor_ros.ros.messages.data_bytes import bytes_of
from horizon_sensor_ros.ros.messages.refusal import Refusal, quoted

# Encoding: bytes a channel, channels, OpenCV's conversion to gray. OpenCV names a Bayer pattern by
# its second row's second and third pixel, ROS by the first two of the first row.
ENCODINGS: dict[str, tuple[int, int, int | None]] = {
    "mono8": (1, 1, None),
    "mono16": (2, 1, None),
    "rgb8": (1, 3, cv2.COLOR_RGB2GRAY),
    "bgr8": (1, 3, cv2.COLOR_BGR2GRAY),
    "rgba8": (1, 4, cv2.COLOR_RGBA2GRAY),
    "bgra8": (1, 4, cv2.COLOR_BGRA2GRAY),
    "bayer_rggb8": (1, 1, cv2.COLOR_BayerBG2GRAY),
    "bayer_bggr8": (1, 1, cv2.COLOR_BayerRG2GRAY),
    "bayer_gbrg8": (1, 1, cv2.COLOR_BayerGR2GRAY),
    "bayer_grbg8": (1, 1, cv2.COLOR_BayerGB2GRAY),
    "bayer_rggb16": (2, 1, cv2.COLOR_BayerBG2GRAY),
    "bayer_bggr16": (2, 1, cv2.COLOR_BayerRG2GRAY),
    "bayer_gbrg16": (2, 1, cv2.COLOR_BayerGR2GRAY),
    "bayer_grbg16": (2, 1, cv2.COLOR_BayerGB2GRAY),
}

_KNOWN_ENCODINGS = f"{', '.join(e for e in ENCODINGS if 'bayer' not in e)} and Bayer's"

# OpenCV's demosaicing needs a neighbour on each side; a smaller frame shows no limb anyway.
_MIN_BAYER_SIZE = 4


def gray_from_image(msg: Any) -> np.ndarray | Refusal:
    """Gray levels (height, width), uint8 or uint16, C-contiguous, of a `sensor_msgs/Image`.

    Without row padding mono8 and native mono16 are views of the message's data, not copies.
    Colour and Bayer patterns are converted to gray.
    """
    encoding = str(msg.encoding)
    if encoding not in ENCODINGS:
        return Refusal(
            "unknown_encoding",
            f"unknown encoding {quoted(encoding)}; known are {_KNOWN_ENCODINGS}",
        )
    item_size, channels, to_gray = ENCODINGS[encoding]
    width, height, step = int(msg.width), int(msg.height), int(msg.step)
    if width <= 0 or height <= 0:
        return Refusal("zero_size", f"image of {width} x {height} pixels")
    row_size = width * channels * item_size
    if step < row_size:
        return Refusal(
            "wrong_step", f"step is {step} bytes, a row of {width} {encoding} pixels has {row_size}"
        )
    data = bytes_of(msg, "image", "step", step * height)
    if isinstance(data, Refusal):
        return data
    if data.size > step * height:
        return Refusal(
            "wrong_step", f"image data has {data.size} bytes, step x height is {step * height}"
        )
    rows = data.reshape(height, step)[:, :row_size]
    if item_size == 2:
        rows = np.ascontiguousarray(rows).view(">u2" if msg.is_bigendian else "<u2")
        rows = np.require(rows, dtype=np.uint16, requirements="A")
        if bytes_swapped(rows):
            told = "the most" if msg.is_bigendian else "the least"
            return Refusal(
                "swapped_bytes",
                f"is_bigendian says {told} significant byte comes first, by its pixels the other "
                "one does",
            )
    if to_gray is None:
        return np.ascontiguousarray(rows)
    if channels == 1 and min(width, height) < _MIN_BAYER_SIZE:
        return Refusal("too_small", f"Bayer image of {width} x {height} pixels")
    shape = (height, width, channels) if channels > 1 else (height, width)
    return cv2.cvtColor(np.ascontiguousarray(rows).reshape(shape), to_gray)
