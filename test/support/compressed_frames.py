"""Images of a recording in other encodings, and compressed as image_transport does it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np
from sensor_msgs.msg import CompressedImage, Image


def encoded(msg: Any, encoding: str) -> Any:
    """A mono8 image in another encoding, its colours unlike each other; other messages as they
    are.
    """
    if not isinstance(msg, Image):
        return msg
    gray = np.frombuffer(msg.data, np.uint8).reshape(msg.height, msg.width)
    pixels = gray
    if encoding in ("rgb8", "bgr8"):
        pixels = np.stack([gray, gray // 2, gray // 3], axis=2)
    elif encoding == "mono16":
        pixels = gray.astype("<u2") * 257
    step = pixels.strides[0]
    out = Image(header=msg.header, height=msg.height, width=msg.width, encoding=encoding, step=step)
    out.data = pixels.tobytes()
    return out


def compressed_recording(
    messages: Iterable[tuple[str, int, Any]], kind: str = ".png"
) -> list[tuple[str, int, Any]]:
    """The same messages with the images compressed, losslessly unless as ".jpg"."""
    return [
        (f"{topic}/compressed", time, _compressed(msg, kind))
        if isinstance(msg, Image)
        else (topic, time, msg)
        for topic, time, msg in messages
    ]


def _compressed(image: Image, kind: str) -> CompressedImage:
    wide = image.encoding == "mono16"
    pixels = np.frombuffer(image.data, np.uint16 if wide else np.uint8)
    pixels = pixels.reshape(image.height, image.width, -1)
    if image.encoding == "rgb8":
        pixels = pixels[:, :, ::-1]
    done, data = cv2.imencode(kind, pixels)
    assert done
    msg = CompressedImage(header=image.header, format=f"{image.encoding}; {kind[1:]} compressed")
    msg.data.frombytes(data.tobytes())
    return msg
