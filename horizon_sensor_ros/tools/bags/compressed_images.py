"""Compressed images of a bag as the images that they were made of."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys.store import Typestore

from horizon_sensor_ros.ros.messages.message_types import IMAGE

SUFFIX = "/compressed"  # by which image_transport names them after the topic of their images
# As they are stored: what a photograph's header says of how to turn it is not the camera's.
_AS_STORED = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION
# By channels and bytes a channel; OpenCV orders colours the other way round than most.
_ENCODINGS = {
    (1, 1): "mono8",
    (1, 2): "mono16",
    (3, 1): "bgr8",
    (4, 1): "bgra8",
}


def decompressed(msg: Any, typestore: Typestore) -> Any:
    """Return the `Image` of a `CompressedImage`; SerdeError where it cannot be decoded.

    A Bayer pattern that was compressed as it is, as its format says, stays one.
    """
    try:
        pixels = cv2.imdecode(np.frombuffer(msg.data, np.uint8), _AS_STORED)
    except cv2.error as error:
        raise SerdeError(f"no image that can be decoded: {error}") from None
    if pixels is None:
        raise SerdeError("no image that can be decoded")
    height, width = pixels.shape[:2]
    channels = 1 if pixels.ndim == 2 else pixels.shape[2]
    encoding = _ENCODINGS.get((channels, pixels.itemsize))
    if encoding is None:
        raise SerdeError(f"{channels} channels of {pixels.dtype} are no known image")
    raw = str(msg.format).split(";")[0].strip()
    if channels == 1 and raw.startswith("bayer_"):
        encoding = raw
    pixels = np.ascontiguousarray(pixels)
    return typestore.types[IMAGE](
        header=msg.header,
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=width * channels * pixels.itemsize,
        data=pixels.view(np.uint8).ravel(),
    )
