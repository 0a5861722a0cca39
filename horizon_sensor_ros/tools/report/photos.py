"""Frames as pictures for the report: what was chosen in them as the limb, and what not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.limb.search.candidates import space_boundary_candidates
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.ros.messages.images import gray_from_image
from horizon_sensor_ros.ros.messages.refusal import Refusal
from horizon_sensor_ros.ros.pictures.debug_image import draw_fix
from horizon_sensor_ros.tools.report.blocks import Photo, photo

_TILE_PX = 480
# BGR of Okabe & Ito's blue-ish and reddish, told apart by the colour-blind; the shapes differ too.
_CHOSEN, _THROWN_AWAY = (233, 180, 86), (0, 94, 213)
_MOST_DOTS = 150
# Candidates nearer to a chosen point than this many of their grid's steps became that point.
_SAME_STEPS = 2.5


def reason_in_words(frames: Sequence[Frame], fix: HorizonFix) -> str:
    """Why there is no fix, or which cameras had no part in it and why."""
    if not fix.ok:
        return fix.reason
    left_out = [
        f"{frame.view.name} left out: {limb.reason or 'its limb lies elsewhere'}"
        for frame, limb in zip(frames, fix.limbs, strict=True)
        if frame.view.name not in fix.cameras_used
    ]
    return "; ".join(left_out)


def plain_photo(camera: str, msg: Any) -> list[Photo]:
    """Photo of an image message as it is; none where it cannot be read."""
    gray = gray_from_image(msg)
    if isinstance(gray, Refusal) or not gray.size:
        return []
    return [photo(f"frame of {camera}", _tile(gray)[0])]


def fix_photos(frames: Sequence[Frame], fix: HorizonFix) -> list[Photo]:
    """Photos of frames, each by itself, with the fix of all of them, as on `~/debug_image`."""
    return [
        photo(_alt(frame, limb), draw_fix((frame,), replace(fix, limbs=(limb,))))
        for frame, limb in zip(frames, fix.limbs, strict=True)
    ]


def choice_photos(frames: Sequence[Frame], fix: HorizonFix) -> list[Photo]:
    """Photos of frames: blue dots on the limb's points, red crosses on candidates that are none."""
    found = []
    for frame, limb in zip(frames, fix.limbs, strict=True):
        picture, scale = _tile(frame.gray)
        for x, y in _thrown_away(frame, limb) * scale:
            at = (round(float(x)), round(float(y)))
            cv2.drawMarker(picture, at, _THROWN_AWAY, cv2.MARKER_TILTED_CROSS, 6, 1, cv2.LINE_AA)
        for x, y in _some(limb.px) * scale:
            at = (round(float(x)), round(float(y)))
            cv2.circle(picture, at, 2, _CHOSEN, -1, cv2.LINE_AA)
        found.append(photo(_alt(frame, limb), picture))
    return found


def _alt(frame: Frame, limb: LimbPoints) -> str:
    told = f"{len(limb.px)} limb points" if len(limb.px) else (limb.reason or str(limb.status))
    return f"frame of {frame.view.name}: {told}"


def _thrown_away(frame: Frame, limb: LimbPoints) -> np.ndarray:
    """Candidates (N, 2), px, that are no point of the limb."""
    candidates = space_boundary_candidates(frame.gray, mask=frame.view.mask)
    px = _some(candidates.px)
    if not len(limb.px) or not len(px):
        return px
    apart = np.linalg.norm(px[:, None] - limb.px[None], axis=2).min(axis=1)
    return px[apart > _SAME_STEPS * max(candidates.pitch_px, 2.0)]


def _some(px: np.ndarray) -> np.ndarray:
    return px[:: 1 + len(px) // _MOST_DOTS]


def _tile(gray: np.ndarray) -> tuple[np.ndarray, float]:
    """Picture (H, W, 3) uint8 of a frame, not wider than a tile, and its scale."""
    scale = min(1.0, _TILE_PX / gray.shape[1])
    if gray.dtype != np.uint8:
        gray = cv2.convertScaleAbs(gray, alpha=255.0 / max(int(gray.max()), 1))
    if scale < 1.0:
        gray = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR), scale
