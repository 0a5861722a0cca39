"""`--mounting`: how far below the horizontal the cameras should look."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.tools.applicability.arguments import check_noise, chosen_views
from horizon_sensor_ros.tools.applicability.expected_sigma import USABLE_DEG
from horizon_sensor_ros.tools.applicability.figures import CIRCLE_COLOUR, EXACT_COLOUR, NOT_SEEN
from horizon_sensor_ros.tools.applicability.mounting_angle import (
    Mountings,
    depression_deg,
    mountings,
)
from horizon_sensor_ros.tools.applicability.table import output_paths, write_csv
from horizon_sensor_ros.tools.camera_file import read_camera_file
from horizon_sensor_ros.tools.output_files import written_whole


def draw_mounting(args: argparse.Namespace) -> str:
    """Write the map over angle and altitude and its table; return the answer."""
    rig = read_camera_file(args.camera_file)
    views = chosen_views(args, rig)
    check_noise(args)
    low_km, high_km = args.mounting
    if not (max(0.0, rig.planet.limb_height_m / 1e3) < low_km <= high_km < 1e6):
        raise ValueError(
            "--mounting must be two altitudes above the limb in km, the lower first, "
            f"got {low_km:g} {high_km:g}"
        )
    tilt_deg = 0.0 if args.tilt is None else args.tilt
    if not 0 <= tilt_deg < 45:
        raise ValueError(f"--tilt must be 0 to 45 degrees, got {tilt_deg:g}")
    heights_m = (1e3 * low_km, 1e3 * high_km)
    files = output_paths(args.output or Path("mounting"))
    found = mountings(views, rig.planet, rig.nadir_at_zero, heights_m, args.sigma, tilt_deg)
    return _draw_map(files, found, views, rig.nadir_at_zero, rig.planet, tilt_deg, args.sigma)


def _draw_map(
    files: tuple[Path, Path],
    found: Mountings,
    views: Sequence[CameraView],
    nadir_at_zero: np.ndarray,
    planet: Planet,
    tilt_deg: float,
    sigma_px: float,
) -> str:
    png, table = files
    sigma_deg = np.degrees(found.sigma_rad)
    angles, heights_km = np.meshgrid(found.depression_deg, found.altitudes_m / 1e3, indexing="ij")
    now = [depression_deg(view, nadir_at_zero) for view in views]
    with written_whole(png, table) as (picture, rows):
        write_csv(
            rows,
            {
                "below_horizontal_deg": angles.ravel(),
                "altitude_km": heights_km.ravel(),
                "sigma_deg": sigma_deg.ravel(),
            },
        )
        _draw_figure(picture, found, sigma_deg, now, planet, tilt_deg, sigma_px)
    return f"{_answer(found, sigma_deg, views, now, tilt_deg)}; wrote {png} and {table}"


def _answer(
    found: Mountings,
    sigma_deg: np.ndarray,
    views: Sequence[CameraView],
    now: Sequence[float],
    tilt_deg: float,
) -> str:
    best = found.best
    low, high = found.altitudes_m[[0, -1]] / 1e3
    where = f"{low:g} to {high:g} km" + (f", craft within {tilt_deg:g} deg" if tilt_deg else "")
    names = ", ".join(
        f"{v.name} now {round(angle, 1) + 0.0:.1f}" for v, angle in zip(views, now, strict=True)
    )
    angle = found.depression_deg[best]
    works = np.isfinite(sigma_deg[best])
    if not works.any():
        return f"no angle shows enough of the horizon at {where} ({names})"
    if not works.all():
        heights = found.altitudes_m[works] / 1e3
        return (
            f"no angle works at all of {where}; {angle:g} deg below the horizontal does at "
            f"{heights[0]:.0f} to {heights[-1]:.0f} km ({names})"
        )
    worst = int(np.argmax(sigma_deg[best]))
    good = found.depression_deg[found.good]
    return (
        f"best {angle:g} deg below the horizontal ({names}): sigma {sigma_deg[best, worst]:.2g} "
        f"deg at worst ({found.altitudes_m[worst] / 1e3:.0f} km) over {where}; "
        f"nearly the same from {good[0]:g} to {good[-1]:g} deg"
    )


def _draw_figure(
    png: Path,
    found: Mountings,
    sigma_deg: np.ndarray,
    now: Sequence[float],
    planet: Planet,
    tilt_deg: float,
    sigma_px: float,
) -> None:
    figure, (upper, lower) = plt.subplots(
        2, 1, figsize=(7.0, 8.0), layout="constrained", sharex=True, height_ratios=(3, 2)
    )
    if found.altitudes_m.size > 1:
        _draw_by_altitude(upper, found, sigma_deg, planet)
    else:
        upper.set_visible(False)
    _draw_by_angle(lower, found, sigma_deg, now)
    tilt = f", craft within {tilt_deg:g} deg" if tilt_deg else ", level craft"
    figure.suptitle(
        f"Expected sigma, all cameras, {sigma_px:g} px a pixel of limb{tilt}.\n"
        f"Grey: none below {USABLE_DEG:g} deg",
        fontsize=11,
    )
    figure.savefig(png, dpi=110)
    plt.close(figure)


def _draw_by_altitude(axes: Axes, found: Mountings, sigma_deg: np.ndarray, planet: Planet) -> None:
    """Sigma (A, H) over angle and altitude, and where the horizon is."""
    values = np.ma.masked_where(~(sigma_deg <= USABLE_DEG), sigma_deg)
    heights_km = found.altitudes_m / 1e3
    axes.set_facecolor(NOT_SEEN)
    low, top = 1e-3, 1.0
    if values.count():
        low = float(values.min())
        top = max(float(np.percentile(values.compressed(), 98)), 1.01 * low)
    image = axes.pcolormesh(
        found.depression_deg, heights_km, values.T, norm=LogNorm(low, top), cmap="viridis",
        shading="nearest", rasterized=True,
    )  # fmt: skip
    axes.figure.colorbar(image, ax=axes, extend="max").set_label("nadir, one sigma (deg)")
    dips = [90.0 - np.degrees(planet.rho_from_altitude(h)) for h in found.altitudes_m]
    axes.plot(dips, heights_km, "--", color="white", linewidth=3.5)
    axes.plot(dips, heights_km, "--", color=CIRCLE_COLOUR, linewidth=1.8, label="the horizon")
    axes.legend(loc="upper right")
    axes.set(yscale="log", ylabel="altitude (km)")
    ticks = heights_km[:: max(1, len(heights_km) // 5)]
    axes.set_yticks(ticks, [f"{tick:.0f}" for tick in ticks])
    axes.minorticks_off()


def _draw_by_angle(
    axes: Axes, found: Mountings, sigma_deg: np.ndarray, now: Sequence[float]
) -> None:
    """Sigma (A, H) over angle at the worst and the best altitude, and the angles as they are."""
    worst = np.where(np.isfinite(sigma_deg.max(axis=1)), sigma_deg.max(axis=1), np.nan)
    axes.semilogy(found.depression_deg, worst, color=EXACT_COLOUR, label="worst altitude")
    axes.semilogy(
        found.depression_deg, sigma_deg.min(axis=1), ":", color=EXACT_COLOUR, label="best altitude"
    )
    best = found.depression_deg[found.best]
    good = found.depression_deg[found.good]
    axes.axvspan(good[0], good[-1], color="0.93", label="nearly the same")
    axes.axvline(best, color=CIRCLE_COLOUR, linewidth=1.8, label=f"best angle, {best:g} deg")
    for i, angle in enumerate(sorted({round(angle, 1) for angle in now})):
        axes.axvline(angle, color="0.4", linestyle="--", label="as in the file" if i == 0 else None)
    axes.grid(visible=True, which="major", color="0.9")
    axes.set(
        xlabel="optical axes below the horizontal (deg)",
        ylabel="nadir, one sigma (deg)",
        xlim=(-1, 90),
    )
    axes.legend(loc="best", fontsize=9)
