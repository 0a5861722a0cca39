"""A frame as a picture in colour to draw on: lines, dashes and words in the frame's own pixels.

Colours are Okabe and Ito's, which colour-blind people tell apart.
"""

from __future__ import annotations

import textwrap

import cv2
import numpy as np

# Blue, green, red.
SKY_BLUE, YELLOW, VERMILLION = (233, 180, 86), (66, 228, 240), (0, 94, 213)
BLUISH_GREEN, PURPLE = (115, 158, 0), (167, 121, 204)
# Lighter than theirs, which beside purple looks too much like it to some.
LIGHT_GREEN = (120, 200, 0)
WHITE, BLACK, GRAY = (255, 255, 255), (0, 0, 0), (180, 180, 180)

# Smaller frames are drawn larger, and larger ones smaller: lines and letters stay readable.
_LEAST_WIDTH, _MOST_WIDTH = 640, 800
_LEAST_HEIGHT, _MOST_HEIGHT = 240, 1600
_FONT, _LETTERS, LINE_PX = cv2.FONT_HERSHEY_SIMPLEX, 0.5, 20
_DASH_PX = 9.0


class Canvas:
    """A picture (H, W, 3) uint8 BGR of gray levels (height, width), which is 640 to 800 pixels wide
    and up to 1600 high, with black beside frames of other shapes.

    scale : pixels of the picture to one of the frame.
    """

    def __init__(self, gray: np.ndarray) -> None:
        height, width = gray.shape
        self.scale = min(max(width, _LEAST_WIDTH), _MOST_WIDTH) / width
        self.scale = min(self.scale, _MOST_HEIGHT / height)
        self.picture = _in_colour(gray, self.scale)

    def places(self, px: np.ndarray) -> list[tuple[int, int]]:
        """Pixels of the frame in the picture."""
        places = np.round((px + 0.5) * self.scale - 0.5).astype(int)
        return [(int(x), int(y)) for x, y in places]

    def line(self, px: np.ndarray, colour: tuple[int, int, int], width: int) -> None:
        """A line through pixels (N, 2) of the frame."""
        if len(px) > 1:
            points = np.array(self.places(px), np.int32)
            cv2.polylines(self.picture, [points], False, colour, width, cv2.LINE_AA)

    def dash(self, px: np.ndarray, colour: tuple[int, int, int], width: int) -> None:
        """The same, dashed."""
        for dash in dashes(px * self.scale):
            self.line(dash / self.scale, colour, width)

    def text(self, text: str, where: tuple[int, int]) -> None:
        """White on the dark, from the left end of its base line."""
        cv2.putText(self.picture, text, where, _FONT, _LETTERS, WHITE, 1, cv2.LINE_AA)

    def label(self, text: str, middle: np.ndarray) -> None:
        """White on a dark box around its middle, within the picture."""
        height, width = self.picture.shape[:2]
        size = np.array([text_width(text) + 10, LINE_PX])
        corner = np.clip(np.round(middle - size / 2), 0, np.array([width, height]) - size)
        self.darken(corner, corner + size)
        self.text(text, (int(corner[0]) + 5, int(corner[1]) + 15))

    def darken(
        self,
        corner: np.ndarray | tuple[int, int],
        end: np.ndarray | tuple[int, int],
        share: float = 0.35,
    ) -> None:
        """Leave a box this share of its brightness; corner, end : x, y in the picture."""
        (left, top), (right, low) = (int(v) for v in corner), (int(v) for v in end)
        part = self.picture[top:low, left:right]
        part[:] = (part * share).astype(np.uint8)


def text_width(text: str) -> int:
    """Width of a text as it is written, pixels."""
    (width, _), _ = cv2.getTextSize(text, _FONT, _LETTERS, 1)
    return int(width)


def wrapped(text: str, width: int) -> list[str]:
    """Lines of a text, in letters that can be drawn, no wider than this many pixels."""
    printable = text.encode("ascii", "replace").decode()
    letters = max(int(len(printable) * width / max(text_width(printable), 1)), 8)
    while letters > 8 and any(
        text_width(line) > width for line in textwrap.wrap(printable, letters)
    ):
        letters -= 1
    return textwrap.wrap(printable, letters) or [""]


def dashes(px: np.ndarray) -> list[np.ndarray]:
    """Every other stretch of a polyline (N, 2), each of a length of `_DASH_PX`."""
    if len(px) < 2:
        return []
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(px, axis=0), axis=1))])
    starts = np.arange(0.0, along[-1], 2 * _DASH_PX)
    places = [np.linspace(start, min(start + _DASH_PX, along[-1]), 4) for start in starts]
    return [np.column_stack([np.interp(p, along, column) for column in px.T]) for p in places]


def _in_colour(gray: np.ndarray, scale: float) -> np.ndarray:
    if scale != 1.0:
        how = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
        height, width = (max(round(scale * size), 1) for size in gray.shape)
        gray = cv2.resize(gray, (width, height), interpolation=how)
    if gray.dtype != np.uint8:
        gray = cv2.convertScaleAbs(gray, alpha=255.0 / max(int(gray.max()), 1))
    below, beside = (
        max(least - size, 0)
        for least, size in zip((_LEAST_HEIGHT, _LEAST_WIDTH), gray.shape, strict=True)
    )
    picture = cv2.copyMakeBorder(gray, 0, below, 0, beside, cv2.BORDER_CONSTANT)
    return cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)
