"""Parameters that name a frame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from horizon_sensor_ros.ros.files.yaml_file import shown


def frame_problems(name: str, accepted: Mapping[str, Any]) -> list[str]:
    """Return what is wrong with the frame that a parameter names; nothing where its value was not
    accepted, for whatever reason.
    """
    if name not in accepted:
        return []
    frame = str(accepted[name])
    if not frame.strip():
        return [f"{name} is empty"]
    if frame.startswith("/"):
        # Nor does tf2 take it: what is published in such a frame would be lost on others.
        return [f"{name} begins with a slash, as no frame's name may: {shown(frame)}"]
    return []
