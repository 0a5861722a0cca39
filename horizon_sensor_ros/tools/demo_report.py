"""The demo's page: errors, the sigmas promised with them, and what the sensors saw."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import cv2
import matplotlib as mpl

mpl.use("Agg")  # no display needed, none opened

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from horizon_sensor_ros.tools.demo_errors import FlightErrors

_LINE, _BAND, _GAP = "#0b6e99", "#0b6e9930", "#d9480f"

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Horizon sensor: simulated flight</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
 body {{ font: 16px/1.5 system-ui, sans-serif; color: #1c2733; background: #fff;
        max-width: 1100px; margin: 2rem auto; padding: 0 1rem; }}
 h1 {{ font-size: 1.6rem; margin-bottom: .2rem; }} h2 {{ font-size: 1.2rem; margin-top: 2rem; }}
 pre {{ background: #f3f6f9; padding: 1rem; overflow-x: auto; font-size: .85rem; }}
 img {{ max-width: 100%; }}
 figure {{ margin: 0 0 1rem; }} figcaption {{ font-size: .85rem; color: #51606f; }}
</style></head><body>
<h1>Horizon sensor: simulated flight</h1>
<p>{summary}</p>
<h2>Errors of the horizon</h2>
<pre>{table}</pre>
<img alt="Error curves" src="{curves}">
<p>Line: error against the simulation's truth. Band: three sigma of the covariance in the message.
Ticks below: moments without an answer.</p>
<h2>What the cameras saw</h2>
<p>The topic <code>attitude_node/debug_image</code>. Yellow: points on the
horizon; crosses: points thrown away. Blue: the horizon of the published fix, dashed where it is
only predicted. White: the way to nadir; in the corner its one-sigma ellipse.</p>
{frames}
<h2>Errors of the target's pose</h2>
<p>A satellite of unknown shape tumbles in front of a range camera (204 x 204 pixels, 5 mm of
noise).</p>
<pre>{target_table}</pre>
<img alt="Error curves of the target" src="{target_curves}">
<p>Line: size of the error against the simulation's truth. Band: three sigma of the covariance in
the message.</p>
{clouds}
</body></html>
"""


@dataclass(frozen=True, eq=False)
class Sample:
    """A picture for the page, (H, W, 3) uint8 BGR: the cameras' frames and what was found there."""

    time_s: float
    picture: np.ndarray


@dataclass(frozen=True, eq=False)
class TargetPart:
    """The page's part on the target: its table, its error curves, and clouds with a caption."""

    table: str
    curves: Figure
    clouds: Figure | None
    caption: str


def write_report(
    path: Path,
    summary: str,
    table: str,
    errors: FlightErrors,
    samples: Sequence[Sample],
    target: TargetPart,
) -> None:
    """Write the page, with everything inside it."""
    clouds = ""
    if target.clouds is not None:
        url = _data_url(_drawn(target.clouds, "png"), "png")
        clouds = _captioned("Clouds of the target", url, target.caption)
    page = _PAGE.format(
        summary=escape(summary),
        table=escape(table),
        curves=_data_url(_drawn(_curves(errors), "svg"), "svg+xml"),
        frames="\n".join(_frame(sample) for sample in samples),
        target_table=escape(target.table),
        target_curves=_data_url(_drawn(target.curves, "svg"), "svg+xml"),
        clouds=clouds,
    )
    path.write_text(page, encoding="utf-8")


def _frame(sample: Sample) -> str:
    encoded, jpeg = cv2.imencode(".jpg", sample.picture, [cv2.IMWRITE_JPEG_QUALITY, 92])
    if not encoded:
        raise RuntimeError("OpenCV could not encode a picture as JPEG")
    caption = f"{sample.time_s:.1f} s"
    return _captioned(f"Frames at {caption}", _data_url(jpeg.tobytes(), "jpeg"), caption)


def _captioned(name: str, url: str, caption: str) -> str:
    return f'<figure><img alt="{name}" src="{url}"><figcaption>{caption}</figcaption></figure>'


def _curves(errors: FlightErrors) -> Figure:
    degrees = np.degrees
    panels: Mapping[str, tuple[np.ndarray, np.ndarray]] = {
        "roll error, deg": (degrees(errors.roll_rad), degrees(errors.roll_sigma_rad)),
        "pitch error, deg": (degrees(errors.pitch_rad), degrees(errors.pitch_sigma_rad)),
        "altitude error, km": (errors.altitude_m / 1e3, errors.altitude_sigma_m / 1e3),
    }
    figure, axes = plt.subplots(len(panels), 1, figsize=(10, 8), sharex=True, layout="constrained")
    for ax, (label, (values, sigmas)) in zip(axes, panels.items(), strict=True):
        _curve(ax, errors.time_s, values, sigmas)
        ax.set_ylabel(label)
    axes[-1].set_xlabel("time, s")
    return figure


def _curve(ax: Axes, time_s: np.ndarray, values: np.ndarray, sigmas: np.ndarray) -> None:
    ax.axhline(0.0, color="0.7", linewidth=0.8)
    ax.fill_between(time_s, -3 * sigmas, 3 * sigmas, color=_BAND, linewidth=0)
    ax.plot(time_s, values, color=_LINE, linewidth=1.2, marker=".", markersize=3)
    missing = time_s[~np.isfinite(values)]
    # At the panel's foot, whatever its scale.
    foot = np.full(len(missing), 0.02)
    ax.plot(missing, foot, "|", color=_GAP, transform=ax.get_xaxis_transform())
    if np.isfinite(values).any():
        # One wild answer must not flatten the rest.
        limit = 1.2 * max(np.nanpercentile(np.abs(values), 99), 3 * float(np.nanmedian(sigmas)))
        ax.set_ylim(-limit, limit)
    ax.grid(alpha=0.3)


def _drawn(figure: Figure, kind: str) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format=kind, dpi=120)
    plt.close(figure)
    return buffer.getvalue()


def _data_url(data: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
