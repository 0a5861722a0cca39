"""The report's part on how well the limb fitted, and why there was no answer, in words."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes

from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.seconds import s_from_ns
from horizon_sensor_ros.tools.colours import COLOURS
from horizon_sensor_ros.tools.reasons import general
from horizon_sensor_ros.tools.report.blocks import (
    Block,
    Section,
    Table,
    Text,
    chart,
    from_zero,
    legend,
)
from horizon_sensor_ros.tools.report.recorded import Diagnosis, Recorded

_REJECTED = "rejected_"
_MARKERS = "ox+^v"
_MOST_REASONS = 12
_RESIDUAL = re.compile(r"(?:(?P<camera>.+)\.)?residual_(?P<unit>px|mm)")


def residuals_section(recorded: Recorded, seen_again: Sequence[Block]) -> Section | None:
    """Return residuals and numbers of points as /diagnostics has them; None without any.

    seen_again : of frames that were processed once more, to stand first.
    """
    blocks = list(seen_again)
    drawn: list[dict[str, list[tuple[int, float]]]] = []
    for name, found in sorted(recorded.diagnostics.items()):
        series = _series(found)
        # Nodes that share a pipeline say the same.
        if not series or series in drawn:
            continue
        drawn.append(series)
        unit = next(iter(series)).rpartition("_")[2]
        blocks.append(
            chart(
                f"Residuals and numbers of points of {name} over time.",
                f"{name}: root mean square distance of the points from what was fitted, and "
                "how many points that were. One mark a message on /diagnostics.",
                partial(_draw, series=series, found=found, unit=unit, recorded=recorded),
                panels=2,
            )
        )
    return Section("residuals", "Residuals", tuple(blocks)) if blocks else None


def fit_blocks(stamped: Sequence[tuple[int, HorizonFit]], start_ns: int) -> tuple[Block, ...]:
    """Residuals and points of fits by their stamps (ns); nothing without any."""
    if not stamped:
        return ()
    times = s_from_ns(np.array([stamp - start_ns for stamp, _ in stamped]))
    fits = [fit for _, fit in stamped]
    return (
        chart(
            "Residuals and numbers of points of the horizon's fits over time.",
            f"{len(fits)} frame sets, evenly chosen and processed once more: root mean square "
            "distance of the limb's points from the fit, and how many points that were.",
            lambda axes: _draw_fits(axes, times, fits),
            panels=2,
        ),
    )


def _series(found: Sequence[Diagnosis]) -> dict[str, list[tuple[int, float]]]:
    series: dict[str, list[tuple[int, float]]] = {}
    for each in found:
        for key in each.values:
            if _RESIDUAL.fullmatch(key) and np.isfinite(each.number(key)):
                series.setdefault(key, []).append((each.time_ns, each.number(key)))
    return series


def _draw(
    axes: Sequence[Axes],
    *,
    series: dict[str, list[tuple[int, float]]],
    found: Sequence[Diagnosis],
    unit: str,
    recorded: Recorded,
) -> None:
    for (key, values), colour, marker in zip(series.items(), COLOURS, _MARKERS, strict=False):
        match = _RESIDUAL.fullmatch(key)
        camera = (match and match["camera"]) or "all"
        times = recorded.seconds([t for t, _ in values])
        numbers = [v for _, v in values]
        axes[0].plot(times, numbers, marker, color=colour, markersize=3, label=camera)
    axes[0].set_ylabel(f"residual ({unit})")
    legend(axes[0])
    points = [(e.time_ns, e.number("points")) for e in found]
    axes[1].plot(recorded.seconds([t for t, _ in points]), [n for _, n in points], ".", color="0.3")
    axes[1].set(ylabel="points", xlabel="time (s)")
    for panel in axes:
        from_zero(panel)


def refusal_blocks(recorded: Recorded) -> list[Block]:
    """Return what was refused, by cause and by reason."""
    blocks: list[Block] = []
    causes = []
    reasons: dict[tuple[str, str], list[int]] = {}
    for name, found in sorted(recorded.diagnostics.items()):
        for key, count in found[-1].values.items():
            if key.startswith(_REJECTED) and count.isdigit() and int(count):
                causes.append((name, key.removeprefix(_REJECTED).replace("_", " "), count))
        for each in found:
            if each.level > 0 and each.message:
                reasons.setdefault((name, general(each.message)), []).append(each.time_ns)
    if causes:
        table = Table(("node", "cause", "number"), tuple(causes), "Frames, sets and clouds refused")
        blocks.append(table)
    if reasons:
        rows = []
        most = sorted(reasons.items(), key=lambda item: -len(item[1]))
        for (name, reason), times in most[:_MOST_REASONS]:
            first, last = recorded.seconds([min(times), max(times)])
            rows.append((name, reason, str(len(times)), f"{first:.1f}", f"{last:.1f}"))
        columns = ("node", "reason", "messages", "first (s)", "last (s)")
        caption = "Reasons on /diagnostics; # stands for a number that varies"
        blocks.append(Table(columns, tuple(rows), caption))
    if not blocks:
        blocks.append(Text("Nothing was refused, as far as /diagnostics tells."))
    return blocks


def _draw_fits(axes: Sequence[Axes], times_s: np.ndarray, fits: Sequence[HorizonFit]) -> None:
    axes[0].plot(times_s, [fit.rms_residual_px for fit in fits], ".", color=COLOURS[0])
    axes[0].set(ylabel="residual (px)")
    axes[1].plot(times_s, [fit.num_inliers for fit in fits], ".", color="0.3")
    axes[1].set(ylabel="points", xlabel="time (s)")
    for panel in axes:
        from_zero(panel)
