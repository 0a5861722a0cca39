"""The picture behind an estimate: limb points, fitted limb, nadir and its uncertainty over frames.

Colours and shapes differ, so that colour-blind people tell them apart as well.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.assessment import inliers
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.planet_figure import Disc, disc_of
from horizon_sensor_ros.ros.pictures.canvas import (
    BLACK,
    BLUISH_GREEN,
    GRAY,
    LIGHT_GREEN,
    LINE_PX,
    PURPLE,
    SKY_BLUE,
    VERMILLION,
    WHITE,
    YELLOW,
    Canvas,
    dashes,
    text_width,
    wrapped,
)

_LIMB_SAMPLES = 1441
_MOST_DOTS = 60
_NEAR_POINTS = 3.0  # spacings of the limb's points: nearer than this the limb was seen
_INSET = 92  # side of the square that shows the uncertainty


def draw_fix(frames: tuple[Frame, ...], fix: HorizonFix) -> np.ndarray:
    """Return the frames side by side, (H, W, 3) uint8 BGR, with what was found in them.

    Each is 640 to 800 pixels wide and up to 1600 high, with black beside frames of other shapes.
    Yellow dots: limb points, some of them. Vermillion crosses: points that the fit threw away. Sky
    blue: the fitted limb, dashed where no point supports it. Light green dashes: the airglow's
    upper edge, where nadir is by that too. White dots: where a limb that is followed was expected
    from the fixes before. White arrow: towards nadir (a cross where nadir is in the frame). Purple,
    in the corner: nadir's one-sigma ellipse as the camera sees it. Above: status and reason.
    """
    tiles = [_Tile(frame, limb, fix).draw() for frame, limb in zip(frames, fix.limbs, strict=True)]
    height = max(tile.shape[0] for tile in tiles)
    padded = [
        cv2.copyMakeBorder(tile, 0, height - tile.shape[0], 0, 0, cv2.BORDER_CONSTANT)
        for tile in tiles
    ]
    return np.ascontiguousarray(np.hstack(padded))


class _Tile:
    """One camera's frame."""

    def __init__(self, frame: Frame, limb: LimbPoints, fix: HorizonFix) -> None:
        self._view, self._limb, self._fix = frame.view, limb, fix
        self._used = fix.ok and frame.view.name in fix.cameras_used
        self._canvas = Canvas(frame.gray)
        self._picture, self._scale = self._canvas.picture, self._canvas.scale

    def draw(self) -> np.ndarray:
        """Draw everything over the frame."""
        if self._fix.predicted is not None:
            self._draw_expected(self._fix.predicted)
        if self._fix.ok:
            self._draw_limb(self._fix.fit)
        if self._fix.airglow is not None and self._used and not self._fix.airglow_alone:
            self._draw_airglow(disc_of(self._fix.fit), self._fix.airglow)
        counts = self._draw_points()
        if self._fix.ok:
            self._draw_nadir(self._fix.fit)
        self._write_status(counts)
        if self._fix.ok:
            self._draw_sigma(self._fix.fit)
        return self._picture

    # ------------------------------------------------------------------ limb

    def _draw_expected(self, disc: Disc) -> None:
        """Where the limb was looked for: small dots, which the fitted limb is drawn over."""
        px = disc.limb_px(self._view, _LIMB_SAMPLES)
        for run in _runs(self._view.camera.in_frame(px), self._near(px)):
            dots = [dash[0] for dash in dashes(px[run] * self._scale)]
            for x, y in self._canvas.places(np.array(dots).reshape(-1, 2) / self._scale):
                cv2.circle(self._picture, (x, y), 2, BLACK, -1, cv2.LINE_AA)
                cv2.circle(self._picture, (x, y), 1, WHITE, -1, cv2.LINE_AA)

    def _draw_limb(self, fit: HorizonFit) -> None:
        """The fitted limb: a line where points support it, dashes where they do not."""
        px = disc_of(fit).limb_px(self._view, _LIMB_SAMPLES)
        inside = self._view.camera.in_frame(px)
        seen = inside & self._supported(px)
        near = self._near(px)
        for run in _runs(inside, near):
            for colour, width in ((BLACK, 3), (SKY_BLUE, 1)):
                for piece in _runs(seen[run], near[run]):
                    self._canvas.line(px[run][piece], colour, width)
                for piece in _runs(~seen[run], near[run]):
                    self._canvas.dash(px[run][piece], colour, width)

    def _draw_airglow(self, disc: Disc, airglow: HorizonFit) -> None:
        """The airglow's upper edge, by which nadir is too: dashes."""
        edge = replace(disc, nadir=airglow.nadir_base, rho_rad=airglow.rho_rad)
        px = edge.limb_px(self._view, _LIMB_SAMPLES)
        for run in _runs(self._view.camera.in_frame(px), self._near(px)):
            for colour, width in ((BLACK, 3), (LIGHT_GREEN, 1)):
                self._canvas.dash(px[run], colour, width)

    def _near(self, px: np.ndarray) -> np.ndarray:
        """Whether places (M, 2) are in the frame or near; far beyond a lens sends them anywhere."""
        camera = self._view.camera
        size = np.array([camera.width, camera.height])
        return np.asarray(((px > -size) & (px < 2 * size)).all(axis=1))

    def _supported(self, px: np.ndarray) -> np.ndarray:
        """Whether limb points that are in use lie beside places (M, 2) on the limb."""
        if not self._used or len(self._limb.px) == 0:
            return np.zeros(len(px), bool)
        blank = np.full((self._view.camera.height, self._view.camera.width), 255, np.uint8)
        x, y = np.rint(self._limb.px).astype(int).T
        blank[y.clip(0, blank.shape[0] - 1), x.clip(0, blank.shape[1] - 1)] = 0
        away = cv2.distanceTransform(blank, cv2.DIST_L2, 3)
        # Before they become whole numbers: far beyond a lens some are too large for any.
        most = np.array(blank.shape[::-1]) - 1
        x, y = np.nan_to_num(px, nan=0.0).clip(0, most).round().astype(int).T
        return away[y, x] <= _NEAR_POINTS * max(self._limb.spacing_px, 2.0)

    def _draw_points(self) -> tuple[int, int]:
        """Draw the limb points; number of those in use and of those thrown away."""
        px = self._limb.px
        kept = self._kept()
        # A share of the points, so that the curve under them can be seen.
        good, bad = px[kept], px[~kept]
        for x, y in self._canvas.places(good[:: 1 + len(good) // _MOST_DOTS]):
            cv2.circle(self._picture, (x, y), 3, BLACK, -1, cv2.LINE_AA)
            cv2.circle(self._picture, (x, y), 2, YELLOW, -1, cv2.LINE_AA)
        for x, y in self._canvas.places(bad[:: 1 + len(bad) // _MOST_DOTS]):
            for colour, width in ((BLACK, 4), (VERMILLION, 2)):
                cv2.drawMarker(
                    self._picture, (x, y), colour, cv2.MARKER_TILTED_CROSS, 9, width, cv2.LINE_AA
                )
        return len(good), len(bad)

    def _kept(self) -> np.ndarray:
        """Mask (N,) of the points that the fit used; all where there is no fit to tell."""
        kept = np.full(len(self._limb.px), not self._fix.ok)
        if self._used:
            off = disc_of(self._fix.fit).residuals_px(self._view, self._limb)
            # Without a ray for each point there is no telling which is which.
            kept = inliers(off) if len(off) == len(kept) else kept
        return kept

    # ------------------------------------------------------------------ nadir

    def _draw_nadir(self, fit: HorizonFit) -> None:
        nadir_cam = fit.nadir_base @ self._view.rot_base_from_cam
        px = self._view.camera.pixels(nadir_cam[None])
        if self._view.camera.in_frame(px)[0]:
            ((x, y),) = self._canvas.places(px)
            for colour, width in ((BLACK, 4), (WHITE, 2)):
                cv2.drawMarker(
                    self._picture, (x, y), colour, cv2.MARKER_CROSS, 21, width, cv2.LINE_AA
                )
            self._canvas.label("nadir", np.array([x + 40, y]))
            return
        length = float(np.hypot(*nadir_cam[:2]))
        if length == 0:
            return
        height, width = self._picture.shape[:2]
        centre = np.array([width, height]) / 2
        ahead = nadir_cam[:2] / length
        tip = centre + ahead * min(height, width) / 4
        ends = [tuple(int(v) for v in np.round(point)) for point in (centre, tip)]
        for colour, thickness in ((BLACK, 5), (WHITE, 2)):
            cv2.arrowedLine(
                self._picture, ends[0], ends[1], colour, thickness, cv2.LINE_AA, tipLength=0.15
            )
        away_deg = np.degrees(np.arctan2(length, nadir_cam[2]))
        text = f"nadir, {away_deg:.0f} deg off axis"
        # Beyond the arrow's tip, as far as its half width reaches that way.
        beyond = 14 + abs(ahead[0]) * text_width(text) / 2
        self._canvas.label(text, tip + beyond * ahead)

    def _draw_sigma(self, fit: HorizonFit) -> None:
        """Nadir's one-sigma ellipse, right and down as in the frame, with its two half axes."""
        cov = sigma_in_frame(self._view, fit)
        values, vectors = np.linalg.eigh(cov)
        sigma_deg = np.degrees(np.sqrt(np.maximum(values, 0.0)))
        if not (np.isfinite(sigma_deg).all() and sigma_deg[1] > 0):
            return
        height, width = self._picture.shape[:2]
        corner = np.array([width - _INSET - 8, height - _INSET - 8])
        self._canvas.darken(corner, corner + _INSET)
        centre = corner + np.array([_INSET / 2, _INSET / 2 - 8])
        half = 0.36 * _INSET * sigma_deg / sigma_deg[1]
        angle = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))
        x, y = (int(v) for v in np.round(centre))
        cv2.line(self._picture, (x - 38, y), (x + 38, y), GRAY, 1)
        cv2.line(self._picture, (x, y - 34), (x, y + 34), GRAY, 1)
        axes = (max(round(half[1]), 1), max(round(half[0]), 1))
        cv2.ellipse(self._picture, (x, y), axes, angle, 0, 360, PURPLE, 2, cv2.LINE_AA)
        text = f"{sigma_deg[1]:.2g} deg"
        left = corner[0] + (_INSET - text_width(text)) / 2
        self._canvas.text(text, (int(left), int(corner[1]) + _INSET - 6))

    # ------------------------------------------------------------------ words

    def _write_status(self, counts: tuple[int, int]) -> None:
        """A strip with the verdict, its reason and the figures."""
        fix, name = self._fix, self._view.name
        verdict = "FIX" if self._used else "LEFT OUT" if fix.ok else "NO FIX"
        colour = BLUISH_GREEN if self._used else VERMILLION
        width = self._picture.shape[1]
        found = f"{counts[0]} points, {counts[1]} thrown away" if fix.ok else f"{counts[0]} points"
        if sum(counts) == 0:
            found = self._limb.reason or str(self._limb.status)
        lines = [f"{name}: {found}"]
        if fix.ok:
            sigma_km = np.sqrt(max(fix.fit.cov_nadir_altitude[3, 3], 0.0)) / 1e3
            lines.append(
                f"altitude {fix.fit.altitude_m / 1e3:.1f} km, sigma {sigma_km:.2g};  "
                f"residual {fix.fit.rms_residual_px:.2f} px"
                + ("; followed" if fix.predicted else "")
                + ("; by the airglow alone" if fix.airglow_alone else "")
            )
        elif (whole := f"{fix.reason or fix.status}") not in found:
            lines.append(whole)
        box = text_width(verdict) + 16
        first = wrapped(lines[0], width - box - 22)
        rows = [*first, *(row for line in lines[1:] for row in wrapped(line, width - 16))]
        self._canvas.darken((0, 0), (width, LINE_PX * len(rows) + 10))
        cv2.rectangle(self._picture, (6, 5), (6 + box, 24), colour, -1)
        self._canvas.text(verdict, (14, 20))
        for i, row in enumerate(rows):
            self._canvas.text(row, (box + 14 if i < len(first) else 8, 20 + LINE_PX * i))


def sigma_in_frame(view: CameraView, fit: HorizonFit) -> np.ndarray:
    """Covariance (2, 2), rad^2, of nadir to the right and downwards in a camera's frame.

    Where nadir lies across an axis of the frame that axis has no component of it, and another that
    is perpendicular to nadir takes its place.
    """
    nadir_cam = fit.nadir_base @ view.rot_base_from_cam
    right = np.eye(3)[0] - nadir_cam[0] * nadir_cam
    if np.linalg.norm(right) < 1e-3:
        right = np.cross(np.eye(3)[1], nadir_cam)
    right /= np.linalg.norm(right)
    down = np.cross(nadir_cam, right)
    # Downwards in the frame, whichever way nadir points along the optical axis.
    down *= 1.0 if down[1] >= 0 else -1.0
    plane = view.rot_base_from_cam @ np.column_stack([right, down])
    return plane.T @ fit.cov_nadir_altitude[:3, :3] @ plane


def _runs(mask: np.ndarray, near: np.ndarray) -> list[slice]:
    """Stretches of a mask (N,) that are true; each takes the next point too where that is near."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    ahead = np.append(near, False).astype(int)
    return [slice(start, end + ahead[end]) for start, end in edges.reshape(-1, 2)]
