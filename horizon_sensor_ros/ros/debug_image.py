"""The picture behind an estimate: horizon points, fitted limb and nadir drawn over the frames."""

from __future__ import annotations

import cv2
import numpy as np

from horizon_sensor_ros.core.attitude import tangent_basis
from horizon_sensor_ros.core.camera import CameraView
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon_sensor import Frame, HorizonFix
from horizon_sensor_ros.core.limb.points import LimbPoints
from horizon_sensor_ros.core.status import Status

# Okabe and Ito's colours, told apart by colour-blind people too; BGR.
_ORANGE = (0, 159, 230)
_SKY_BLUE = (233, 180, 86)
_YELLOW = (66, 228, 240)
_WHITE = (255, 255, 255)
_BLACK = (0, 0, 0)
# Yellow shows on dark ground, its outline on bright.
_OUTLINED = ((_BLACK, 3), (_YELLOW, 1))

_MAX_WIDTH = 800
_LIMB_SAMPLES = 721
_MAX_DOTS = 50


def draw_fix(frames: tuple[Frame, ...], fix: HorizonFix) -> np.ndarray:
    """Return the frames side by side, (H, W, 3) uint8 BGR, with what was found in them.

    Orange: horizon points, some of them. Sky blue: the fitted limb. Yellow: nadir, or an arrow
    towards it. A frame wider than 800 pixels is drawn smaller.
    """
    tiles = [_draw_frame(frame, limb, fix) for frame, limb in zip(frames, fix.limbs, strict=True)]
    height = max(tile.shape[0] for tile in tiles)
    padded = [
        cv2.copyMakeBorder(tile, 0, height - tile.shape[0], 0, 0, cv2.BORDER_CONSTANT)
        for tile in tiles
    ]
    return np.ascontiguousarray(np.hstack(padded))


def _draw_frame(frame: Frame, limb: LimbPoints, fix: HorizonFix) -> np.ndarray:
    gray = frame.gray
    scale = min(1.0, _MAX_WIDTH / gray.shape[1])
    if scale < 1.0:
        gray = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    if gray.dtype != np.uint8:
        gray = cv2.convertScaleAbs(gray, alpha=255.0 / max(int(gray.max()), 1))
    picture = cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR)
    if fix.status is Status.OK:
        for piece in _limb_pieces(frame.view, fix.fit):
            cv2.polylines(picture, [_scaled(piece, scale)], False, _SKY_BLUE, 1, cv2.LINE_AA)
        _draw_nadir(picture, frame.view, fix.fit, scale)
    # A share of the points, so that the curve under them can be seen.
    for x, y in _scaled(limb.px, scale)[:: 1 + len(limb.px) // _MAX_DOTS]:
        cv2.circle(picture, (int(x), int(y)), 2, _ORANGE, -1, cv2.LINE_AA)
    _write(picture, _caption(frame, limb, fix))
    return picture


def _scaled(px: np.ndarray, scale: float) -> np.ndarray:
    return np.round((px + 0.5) * scale - 0.5).astype(np.int32)


def _limb_pieces(view: CameraView, fit: HorizonFit) -> list[np.ndarray]:
    """Return the fitted limb's pixels (N, 2), one array for each piece inside the frame."""
    angle = np.linspace(0.0, 2 * np.pi, _LIMB_SAMPLES)
    across = tangent_basis(fit.nadir_base) @ np.array([np.cos(angle), np.sin(angle)])
    rays_base = np.cos(fit.rho_rad) * fit.nadir_base + np.sin(fit.rho_rad) * across.T
    px = view.camera.pixels(rays_base @ view.rot_base_from_cam)
    inside = view.camera.in_frame(px)
    runs = np.split(np.arange(len(px)), np.flatnonzero(np.diff(inside)) + 1)
    return [px[run] for run in runs if inside[run[0]] and len(run) > 1]


def _draw_nadir(picture: np.ndarray, view: CameraView, fit: HorizonFit, scale: float) -> None:
    nadir_cam = fit.nadir_base @ view.rot_base_from_cam
    px = view.camera.pixels(nadir_cam[None])
    if view.camera.in_frame(px)[0]:
        x, y = _scaled(px, scale)[0]
        for colour, width in _OUTLINED:
            cv2.drawMarker(
                picture, (int(x), int(y)), colour, cv2.MARKER_CROSS, 15, width, cv2.LINE_AA
            )
        return
    length = float(np.hypot(*nadir_cam[:2]))
    if length == 0:
        return
    centre = np.array([picture.shape[1], picture.shape[0]]) / 2
    tip = centre + nadir_cam[:2] / length * min(picture.shape[:2]) / 4
    start, end = (tuple(int(v) for v in np.round(point)) for point in (centre, tip))
    for colour, width in _OUTLINED:
        cv2.arrowedLine(picture, start, end, colour, width, cv2.LINE_AA, tipLength=0.1)


def _caption(frame: Frame, limb: LimbPoints, fix: HorizonFix) -> list[str]:
    name = frame.view.name
    if limb.status is Status.OK:
        lines = [f"{name}: {len(limb.px)} points"]
    else:
        lines = [f"{name}: {limb.reason or limb.status}"]
    if fix.status is not Status.OK:
        lines.append(f"no fix: {fix.reason or fix.status}")
    else:
        if name not in fix.cameras_used:
            lines.append("left out")
        lines.append(f"altitude {fix.fit.altitude_m / 1e3:.1f} km")
        lines.append(f"residual {fix.fit.rms_residual_px:.3f} px")
    return lines


def _write(picture: np.ndarray, lines: list[str]) -> None:
    size = 0.4
    for row, line in enumerate(lines):
        where = (4, 14 + 15 * row)
        text = line.encode("ascii", "replace").decode()
        for colour, width in ((_BLACK, 3), (_WHITE, 1)):
            cv2.putText(
                picture, text, where, cv2.FONT_HERSHEY_SIMPLEX, size, colour, width, cv2.LINE_AA
            )
