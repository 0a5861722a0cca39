"""The report's part on the horizon's answers: attitude, altitude, nadir, and how sure they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from horizon_sensor_ros.core.mathematics.attitude import roll_pitch_from_nadir
from horizon_sensor_ros.ros.messages.geometry import xyz_of
from horizon_sensor_ros.tools.colours import BLUE, COLOURS, GREEN, VERMILION
from horizon_sensor_ros.tools.report.blocks import (
    Block,
    Section,
    Table,
    band,
    chart,
    figures,
    legend,
    with_gaps,
)
from horizon_sensor_ros.tools.report.recorded import Recorded
from horizon_sensor_ros.tools.truth.horizon_errors import (
    FlightErrors,
    attitude_sigmas,
    nadir_and_altitude,
)

# A scale that spans less than this is linear.
_LEAST_LOGARITHMIC = 10.0


@dataclass(frozen=True, eq=False)
class Attitudes:
    """All of `attitude`, (N,) each; level_z as the altitudes' sign tells."""

    stamps: tuple[int, ...]
    time_s: np.ndarray
    level_z: str
    roll_rad: np.ndarray
    pitch_rad: np.ndarray
    altitude_m: np.ndarray
    nadir_sigma_rad: np.ndarray
    roll_sigma_rad: np.ndarray
    pitch_sigma_rad: np.ndarray
    altitude_sigma_m: np.ndarray


class Quantity(NamedTuple):
    """One of roll, pitch and altitude: values and sigmas (N,) in the unit, and its colour."""

    name: str
    unit: str
    values: np.ndarray
    sigma: np.ndarray
    colour: str


def quantities(of: Attitudes | FlightErrors) -> tuple[Quantity, ...]:
    """Return roll, pitch and altitude as they are shown, of answers or of their errors."""
    roll, roll_sigma = np.degrees(of.roll_rad), np.degrees(of.roll_sigma_rad)
    pitch, pitch_sigma = np.degrees(of.pitch_rad), np.degrees(of.pitch_sigma_rad)
    altitude, altitude_sigma = of.altitude_m / 1e3, of.altitude_sigma_m / 1e3
    return (
        Quantity("roll", "deg", roll, roll_sigma, BLUE),
        Quantity("pitch", "deg", pitch, pitch_sigma, VERMILION),
        Quantity("altitude", "km", altitude, altitude_sigma, GREEN),
    )


def attitudes(recorded: Recorded) -> Attitudes | None:
    """Return the answers on `attitude`; None where there are none."""
    messages = dict(sorted(recorded.answers.get("attitude", {}).items()))
    if not messages:
        return None
    heights = [m.pose.pose.position.z for m in messages.values()]
    level_z = "up" if np.median(heights) >= 0 else "down"
    told = [nadir_and_altitude(m, level_z) for m in messages.values()]
    angles = np.array([roll_pitch_from_nadir(nadir, level_z) for nadir, _ in told])
    cov = np.array([np.reshape(m.pose.covariance, (6, 6)) for m in messages.values()])
    sigmas = attitude_sigmas(cov, angles[:, 1])
    return Attitudes(
        stamps=tuple(messages),
        time_s=recorded.seconds(list(messages)),
        level_z=level_z,
        roll_rad=angles[:, 0],
        pitch_rad=angles[:, 1],
        altitude_m=np.array([a for _, a in told]),
        nadir_sigma_rad=sigmas.nadir_rad,
        roll_sigma_rad=sigmas.roll_rad,
        pitch_sigma_rad=sigmas.pitch_rad,
        altitude_sigma_m=sigmas.altitude_m,
    )


def attitude_section(recorded: Recorded) -> Section | None:
    """Return roll, pitch, altitude and nadir over time; None where neither is answered."""
    found = attitudes(recorded)
    blocks: list[Block] = []
    if found is not None:
        blocks += [
            _summary(found),
            chart(
                "Roll, pitch and altitude over time, each with a band of three sigma.",
                f"Base frame in local_level (z {found.level_z}). Band: three sigma of the "
                "covariance in the message; often thinner than the line.",
                lambda axes: _draw_attitude(axes, found),
                panels=3,
            ),
            chart(
                "One sigma of roll, pitch and altitude over time.",
                "How sure each answer says it is.",
                lambda axes: _draw_sigmas(axes, found),
                panels=2,
            ),
        ]
    verticals = dict(sorted(recorded.answers.get("local_vertical", {}).items()))
    if verticals:
        nadir = np.array([xyz_of(m.vector) for m in verticals.values()])
        time_s = recorded.seconds(list(verticals))
        blocks.append(
            chart(
                "The three components of nadir in the base frame over time.",
                "local_vertical: unit vector towards the planet.",
                lambda axes: _draw_nadir(axes[0], time_s, nadir),
                panel_height=2.0,
            )
        )
    if not blocks:
        return None
    return Section("attitude", "Nadir, roll, pitch and altitude", tuple(blocks))


def _summary(found: Attitudes) -> Table:
    def row(one: Quantity) -> tuple[str, ...]:
        spread = (one.values.min(), np.median(one.values), one.values.max())
        median_sigma = figures(np.median(one.sigma))
        return (f"{one.name} ({one.unit})", *(f"{v:.4g}" for v in spread), *median_sigma)

    return Table(
        ("", "least", "median", "most", "median sigma"), tuple(map(row, quantities(found)))
    )


def _draw_attitude(axes: Sequence[Axes], found: Attitudes) -> None:
    for panel, one in zip(axes, quantities(found), strict=True):
        name = f"{one.name} ({one.unit})"
        band(panel, found.time_s, one.values, one.sigma, one.colour, name)
        panel.set_ylabel(name)
    axes[-1].set_xlabel("time (s)")


def _draw_sigmas(axes: Sequence[Axes], found: Attitudes) -> None:
    time_s, roll, pitch, altitude = with_gaps(
        found.time_s,
        np.degrees(found.roll_sigma_rad),
        np.degrees(found.pitch_sigma_rad),
        found.altitude_sigma_m / 1e3,
    )
    axes[0].plot(time_s, roll, color=BLUE, label="roll")
    axes[0].plot(time_s, pitch, color=VERMILION, linestyle="--", label="pitch")
    axes[0].set_ylabel("one sigma (deg)")
    legend(axes[0])
    axes[1].plot(time_s, altitude, color=GREEN)
    axes[1].set_ylabel("one sigma (km)")
    axes[1].set_xlabel("time (s)")
    for panel, sigmas in zip(axes, ((roll, pitch), (altitude,)), strict=True):
        known = np.concatenate(sigmas)
        # Who does not know them may say zero.
        known = known[known > 0.0]
        if known.size and known.max() > _LEAST_LOGARITHMIC * known.min():
            panel.set_yscale("log")


def _draw_nadir(axes: Axes, time_s: np.ndarray, nadir: np.ndarray) -> None:
    styles = ("-", "--", ":")
    for axis, colour, style in zip(range(3), COLOURS, styles, strict=False):
        t, values = with_gaps(time_s, nadir[:, axis])
        axes.plot(t, values, color=colour, linestyle=style, label="xyz"[axis])
    axes.set(xlabel="time (s)", ylabel="nadir, base frame", ylim=(-1.05, 1.05))
    legend(axes)
