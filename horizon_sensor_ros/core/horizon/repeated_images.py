"""Cameras that show the very same image again although something has moved: they are frozen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from horizon_sensor_ros.core.aiding import Aiding
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.motion.turn_rate import (
    GYRO_SIGMA_RAD_S,
    NOT_TURNED,
    SURE,
    surely_turns,
)

# An image is frozen when another camera's has changed so often meanwhile, or the craft has turned
# by more than a part of a pixel and `SURE` times what a gyro may be off by in that time. A limb
# is known to some hundredths of a pixel: a whole one would be many sigmas of its fix.
_OTHERS_CHANGED, _LEAST_PX = 2, 0.1
_ROWS = 16  # that are compared one by one before all are: images that differ do so in most of them


@dataclass(eq=False)
class _Shown:
    """An image as it was first shown, and what happened since.

    others : sets in which another camera's image changed. rot_now_from_first (3, 3), time_s : the
    gyro's turn, and over which time that is known.
    """

    gray: np.ndarray
    others: int = 0
    rot_now_from_first: np.ndarray = field(default_factory=lambda: NOT_TURNED)
    time_s: float = 0.0


class RepeatedImages:
    """Remembers each camera's last image.

    No two images of a live camera are the same to the last bit. That alone says nothing where all
    stands still, as with a picture that is published again and again.
    """

    def __init__(self) -> None:
        self._shown: dict[str, _Shown] = {}

    def marked(self, frames: Sequence[Frame], aiding: Aiding) -> list[Frame]:
        """Return the frames; those of frozen cameras say so (`Frame.unusable`)."""
        repeated = [self._repeats(frame) for frame in frames]
        changed = [
            not same and frame.view.name in self._shown
            for frame, same in zip(frames, repeated, strict=True)
        ]
        shown, out = {}, []
        for i, frame in enumerate(frames):
            name, reason = frame.view.name, ""
            if repeated[i]:
                others = any(changed[:i] + changed[i + 1 :])
                shown[name] = _once_more(self._shown[name], others, aiding)
                reason = _frozen(shown[name], frame)
            else:
                shown[name] = _Shown(frame.gray)
            out.append(replace(frame, unusable=reason) if reason else frame)
        self._shown.update(shown)
        return out

    def _repeats(self, frame: Frame) -> bool:
        last = self._shown.get(frame.view.name)
        if last is None:
            return False
        gray, before = frame.gray, last.gray
        # What is no image at all is refused by who looks at it.
        if gray is before:
            return isinstance(gray, np.ndarray) and gray.ndim == 2
        return (
            isinstance(gray, np.ndarray)
            and isinstance(before, np.ndarray)
            and gray.ndim == 2
            and gray.shape == before.shape
            and all((gray[i] == before[i]).all() for i in _some_rows(len(gray)))
            and np.array_equal(gray, before)
        )


def _some_rows(count: int) -> range:
    """Rows all over an image of so many, the middle one first: a border's may be black sky."""
    return range(-(count // 2), count - count // 2, max(1, count // _ROWS))


def _once_more(shown: _Shown, others: bool, aiding: Aiding) -> _Shown:
    """Return what is known of an image that is shown again."""
    turn, since_s, rate = aiding.rot_now_from_last, aiding.since_last_s, aiding.rate_base_rad_s
    # The rate is a median: one glitch of the gyro, which the turn has, is no turn of the craft.
    turns = rate is not None and surely_turns(rate)
    again = replace(shown, others=shown.others + others)
    if turn is None or since_s is None or not turns:
        return again
    return replace(
        again,
        rot_now_from_first=turn @ shown.rot_now_from_first,
        time_s=shown.time_s + since_s,
    )


def _frozen(shown: _Shown, frame: Frame) -> str:
    """Why an image that is shown again cannot be of now; empty where it may be."""
    cosine = 0.5 * (float(np.trace(shown.rot_now_from_first)) - 1.0)
    turn_rad = math.acos(min(max(cosine, -1.0), 1.0))
    least_rad = _LEAST_PX * frame.view.camera.pixel_rad
    if turn_rad > least_rad + SURE * GYRO_SIGMA_RAD_S * shown.time_s:
        moved = f"the craft has turned by {math.degrees(turn_rad):.1f} deg since"
    elif shown.others >= _OTHERS_CHANGED:
        moved = f"other cameras' images have changed {shown.others} times since"
    else:
        return ""
    return f"the very same image again, though {moved}: has the camera, or its driver, stopped?"
