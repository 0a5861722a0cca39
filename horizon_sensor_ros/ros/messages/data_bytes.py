"""The bytes of an image or a cloud, as long as its rows say."""

from __future__ import annotations

from typing import Any

import numpy as np

from horizon_sensor_ros.ros.messages.refusal import Refusal


def bytes_of(msg: Any, what: str, step: str, least: int) -> np.ndarray | Refusal:
    """View of a message's data, (N,) uint8, at least so many bytes.

    what, step : the message, and its field that says how long a row is, for a person.
    """
    try:
        data = np.frombuffer(msg.data, dtype=np.uint8)
    except (TypeError, ValueError, BufferError) as error:
        return Refusal("bad_data", f"{what} data is not bytes: {error}")
    if data.size < least:
        return Refusal(
            "truncated_data", f"{what} data has {data.size} bytes, {step} x height is {least}"
        )
    return data
