"""What a report is made of: sections of text, tables, charts and photographs."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import matplotlib as mpl

mpl.use("Agg")  # no display needed, none opened

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg

# Width in inches, dots an inch, size of type: for a desktop, and for a phone held upright.
_WIDE, _NARROW = (9.2, 110, 9.0), (3.7, 190, 7.5)
_JPEG_QUALITY = 85


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str
    kind: str = "text"


@dataclass(frozen=True)
class Table:
    """Rows of cells; numbers are set to the right."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    kind: str = "table"


@dataclass(frozen=True)
class Chart:
    """A drawing in two shapes, as data URLs; alt says what it shows to who cannot see it."""

    alt: str
    caption: str
    wide: str
    narrow: str
    kind: str = "chart"


@dataclass(frozen=True)
class Photo:
    """A picture of one frame, as data URL."""

    alt: str
    url: str


@dataclass(frozen=True)
class Photos:
    """Pictures that belong together."""

    photos: tuple[Photo, ...]
    caption: str
    kind: str = "photos"


Block = Text | Table | Chart | Photos


@dataclass(frozen=True)
class Section:
    """A heading and what is under it; key names it in links."""

    key: str
    title: str
    blocks: tuple[Block, ...]


def chart(
    alt: str,
    caption: str,
    draw: Callable[[Sequence[Axes]], None],
    *,
    panels: int = 1,
    columns: int = 1,
    panel_height: float = 1.7,
    share_x: bool = True,
) -> Chart:
    """Have a chart drawn in both shapes; draw gets its panels, row after row.

    panels : one above the other, columns : beside each other; on a phone all are one above the
    other.
    """
    urls = []
    for (width, dpi, size), shape in (
        (_WIDE, (panels, columns)),
        (_NARROW, (panels * columns, 1)),
    ):
        with mpl.rc_context({"font.size": size, "axes.grid": True, "grid.alpha": 0.3}):
            figure, axes = plt.subplots(
                *shape,
                figsize=(width, panel_height * shape[0] + 0.6),
                dpi=dpi,
                sharex=share_x,
                squeeze=False,
                layout="constrained",
            )
            draw(axes.ravel().tolist())
            buffer = io.BytesIO()
            # `savefig` goes through all that is drawn once more beforehand, for the same picture.
            FigureCanvasAgg(figure).print_png(buffer)
            plt.close(figure)
        urls.append(_data_url(buffer.getvalue(), "png"))
    return Chart(alt, caption, urls[0], urls[1])


def photo(alt: str, bgr: np.ndarray) -> Photo:
    """Photo of an (H, W, 3) uint8 picture."""
    encoded, jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    if not encoded:
        raise RuntimeError("OpenCV could not encode a picture as JPEG")
    return Photo(alt, _data_url(jpeg.tobytes(), "jpeg"))


def _data_url(data: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def with_gaps(time_s: np.ndarray, *values: np.ndarray) -> tuple[np.ndarray, ...]:
    """Time and values with a NaN in every gap, so that no line is drawn across it."""
    if len(time_s) < 3:
        return (time_s, *values)
    steps = np.diff(time_s)
    after = np.flatnonzero(steps > 2.5 * np.median(steps)) + 1
    return tuple(np.insert(np.asarray(v, float), after, np.nan) for v in (time_s, *values))


def legend(axes: Axes) -> None:
    """Name the lines above the panel, where they hide nothing."""
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, frameon=False, borderpad=0.1)


def from_zero(axes: Axes) -> None:
    """Begin a panel's scale at zero, with room above the largest value."""
    axes.set_ylim(0.0, 1.08 * axes.get_ylim()[1])


def figures(*values: float) -> tuple[str, ...]:
    """Cells of three significant digits."""
    return tuple(f"{value + 0.0:.3g}" for value in values)


def band(
    axes: Axes, time_s: np.ndarray, values: np.ndarray, sigma: np.ndarray, colour: str, name: str
) -> None:
    """Draw a line with a band of three sigma about it."""
    t, v, s = with_gaps(time_s, values, sigma)
    axes.fill_between(t, v - 3 * s, v + 3 * s, color=colour, alpha=0.25, linewidth=0)
    axes.plot(t, v, color=colour, linewidth=1.2, marker=".", markersize=2.5, label=name)


def error_band(
    axes: Axes, time_s: np.ndarray, errors: np.ndarray, sigma: np.ndarray, colour: str
) -> None:
    """Draw errors over a band of three sigma about zero; one wild value does not flatten all."""
    seen = np.isfinite(errors)
    t, e, s = with_gaps(time_s[seen], errors[seen], sigma[seen])
    axes.axhline(0.0, color="0.6", linewidth=0.8)
    axes.fill_between(t, -3 * s, 3 * s, color=colour, alpha=0.2, linewidth=0, label="3 sigma")
    axes.plot(t, e, color=colour, linewidth=1.0, marker=".", markersize=3, label="error")
    if seen.any():
        limit = 1.2 * max(
            float(np.nanpercentile(np.abs(errors), 99)), 3 * float(np.nanpercentile(sigma, 90))
        )
        if limit > 0.0:
            axes.set_ylim(-limit, limit)
