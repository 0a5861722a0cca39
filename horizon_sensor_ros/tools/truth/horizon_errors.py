"""What the nodes said, held against the flight's truth."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3Stamped

from horizon_sensor_ros.core.mathematics.attitude import (
    angle_rad,
    level_from_base,
    nadir_sign,
    roll_pitch_from_nadir,
)
from horizon_sensor_ros.ros.messages.geometry import rotation_of, xyz_of
from horizon_sensor_ros.tools.truth.columns import columns_of
from horizon_sensor_ros.tools.truth.nees import nees, within_95

_Z, _ROT_X, _ROT_Y = 2, 3, 4
# Towards nose up or down roll is not defined, and its sigma grows without bound.
_LEAST_COS_PITCH = 1e-3


@dataclass(frozen=True, eq=False)
class Truth:
    """Truth of one moment: nadir (3,) in the base frame, and altitude."""

    stamp: int
    time_s: float
    nadir_base: np.ndarray
    altitude_m: float


@dataclass(frozen=True, eq=False)
class FlightErrors:
    """Errors and their sigmas, (N,), NaN where there was no answer; one row a moment of the flight.

    vertical_rad is of `local_vertical`, everything else of `attitude`. nees: of altitude, roll and
    pitch together, three degrees of freedom.
    """

    time_s: np.ndarray
    vertical_rad: np.ndarray
    nadir_rad: np.ndarray
    nadir_sigma_rad: np.ndarray
    roll_rad: np.ndarray
    roll_sigma_rad: np.ndarray
    pitch_rad: np.ndarray
    pitch_sigma_rad: np.ndarray
    altitude_m: np.ndarray
    altitude_sigma_m: np.ndarray
    nees: np.ndarray


@dataclass(frozen=True, eq=False)
class AttitudeSigmas:
    """One sigma of what `attitude` messages state, each (N,) or a scalar."""

    nadir_rad: np.ndarray
    roll_rad: np.ndarray
    pitch_rad: np.ndarray
    altitude_m: np.ndarray


def attitude_sigmas(covariance: np.ndarray, pitch_rad: np.ndarray | float) -> AttitudeSigmas:
    """Sigmas of covariances (..., 6, 6) as in `attitude`, of pitches (...).

    Nadir's is of its whole error, the root of both variances' sum: the rotations are about the
    level frame's axes, so at no pitch does it depend on how roll is defined.
    """
    variances = np.einsum("...ii->...i", covariance)
    sigma = np.sqrt(np.maximum(variances, 0.0))
    about_x, about_y = sigma[..., _ROT_X], sigma[..., _ROT_Y]
    return AttitudeSigmas(
        nadir_rad=np.hypot(about_x, about_y),
        roll_rad=about_x / np.maximum(np.cos(pitch_rad), _LEAST_COS_PITCH),
        pitch_rad=about_y,
        altitude_m=sigma[..., _Z],
    )


def nadir_and_altitude(
    message: PoseWithCovarianceStamped, level_z: str
) -> tuple[np.ndarray, float]:
    """Nadir (3,) in the base frame and altitude in metres that an `attitude` message states."""
    rot_level_from_base = rotation_of(message.pose.pose.orientation)
    sign = nadir_sign(level_z)
    return sign * rot_level_from_base[2], -sign * message.pose.pose.position.z


def flight_errors(
    truths: Sequence[Truth],
    verticals: Mapping[int, Vector3Stamped],
    attitudes: Mapping[int, PoseWithCovarianceStamped],
    level_z: str,
) -> FlightErrors:
    """Errors of the answers, found by stamp, against the truths."""
    rows = []
    for truth in truths:
        row = {"time_s": truth.time_s}
        if truth.stamp in verticals:
            v = verticals[truth.stamp].vector
            row["vertical_rad"] = angle_rad(xyz_of(v), truth.nadir_base)
        if truth.stamp in attitudes:
            row |= _attitude_errors(attitudes[truth.stamp], truth, level_z)
        rows.append(row)
    return FlightErrors(**columns_of(FlightErrors, rows))


def _attitude_errors(
    message: PoseWithCovarianceStamped, truth: Truth, level_z: str
) -> dict[str, float]:
    """Of one answer, by the names of `FlightErrors`."""
    nadir, altitude = nadir_and_altitude(message, level_z)
    roll, pitch = roll_pitch_from_nadir(nadir, level_z)
    true_roll, true_pitch = roll_pitch_from_nadir(truth.nadir_base, level_z)
    covariance = np.array(message.pose.covariance).reshape(6, 6)
    block = covariance[np.ix_([_Z, _ROT_X, _ROT_Y], [_Z, _ROT_X, _ROT_Y])]
    sign = nadir_sign(level_z)
    # Rotation error about the level frame's axes, from nadir's error in that frame.
    d = level_from_base(nadir, level_z) @ (nadir - truth.nadir_base)
    error = np.array([-sign * (altitude - truth.altitude_m), sign * d[1], -sign * d[0]])
    sigmas = attitude_sigmas(covariance, pitch)
    return {
        "nadir_rad": angle_rad(nadir, truth.nadir_base),
        "nadir_sigma_rad": float(sigmas.nadir_rad),
        "roll_rad": _wrapped(roll - true_roll),
        "roll_sigma_rad": float(sigmas.roll_rad),
        "pitch_rad": pitch - true_pitch,
        "pitch_sigma_rad": float(sigmas.pitch_rad),
        "altitude_m": altitude - truth.altitude_m,
        "altitude_sigma_m": float(sigmas.altitude_m),
        "nees": nees(error, block),
    }


def error_lines(
    rows: Iterable[tuple[str, str, np.ndarray, np.ndarray | None]],
) -> list[str]:
    """Lines of a table: of each quantity (name, unit, errors, sigmas) the magnitudes' spread.

    Errors (N,) and sigmas (N,) are NaN where there was no answer.
    """
    lines = [f"{'error against truth':26}{'':6}{'median':>9}{'95 %':>9}{'max':>9}{'1 sigma':>10}"]
    for name, unit, values, sigmas in rows:
        sizes = np.abs(values[np.isfinite(values)])
        figures = (
            "".join(f"{v:9.4f}" for v in (*np.percentile(sizes, [50, 95]), sizes.max()))
            if sizes.size
            else f"{'-':>9}" * 3
        )
        stated = "" if sigmas is None or not sizes.size else f"{np.nanmedian(sigmas):10.4f}"
        lines.append(f"{name:26}{unit:6}{figures}{stated}")
    return lines


def latency_line(what: str, latency_s: np.ndarray) -> str:
    """Return the line of a table on latencies (N,)."""
    median_ms, most_ms = 1e3 * np.median(latency_s), 1e3 * np.percentile(latency_s, 95)
    return f"latency        {what}: median {median_ms:.0f} ms, 95 % {most_ms:.0f} ms"


def error_table(errors: FlightErrors, latency_s: np.ndarray) -> str:
    """Return the table that the demo prints: of magnitudes, over the moments with an answer."""
    degrees, kilometres = np.degrees, 1e-3
    rows = (
        ("local_vertical: nadir", "deg", degrees(errors.vertical_rad), None),
        ("attitude: nadir", "deg", degrees(errors.nadir_rad), degrees(errors.nadir_sigma_rad)),
        ("attitude: roll", "deg", degrees(errors.roll_rad), degrees(errors.roll_sigma_rad)),
        ("attitude: pitch", "deg", degrees(errors.pitch_rad), degrees(errors.pitch_sigma_rad)),
        (
            *("attitude: altitude", "km"),
            *(errors.altitude_m * kilometres, errors.altitude_sigma_m * kilometres),
        ),
    )
    lines = error_lines(rows)
    seen = errors.nees[np.isfinite(errors.nees)]
    moments = len(errors.time_s)
    vertical, attitude = (
        int(np.isfinite(v).sum()) for v in (errors.vertical_rad, errors.nadir_rad)
    )
    lines += [
        "",
        f"availability   local_vertical {vertical} of {moments} ({vertical / moments:.0%}), "
        f"attitude {attitude} of {moments} ({attitude / moments:.0%})",
    ]
    if seen.size:
        lines += [
            f"NEES           mean {seen.mean():.2f} (altitude, roll, pitch: 3 is exact over many "
            f"flights); {within_95(seen, 3):.0%} of the errors within the 95 % ellipsoid",
            f"{'':15}Of one flight it says little: its errors hang together, the altitude's most,",
            f"{'':15}while clouds and air at the limb stay much the same. More: doc/report.md",
            latency_line("image published to attitude heard", latency_s)
            + " (the rendering runs on the same cores)",
        ]
    return "\n".join(lines)


def _wrapped(angle: float) -> float:
    return float((angle + np.pi) % (2 * np.pi) - np.pi)
