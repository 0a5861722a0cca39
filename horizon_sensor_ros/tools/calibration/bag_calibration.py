"""What `horizon_self_calibration` does: a bag to frame sets, to a calibration, to files."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from horizon_sensor_ros.core.self_calibration.adjustment import calibrate
from horizon_sensor_ros.core.self_calibration.corner_blur import lens_blurs
from horizon_sensor_ros.core.self_calibration.lens_check import with_lenses_checked
from horizon_sensor_ros.core.self_calibration.result import Calibration, CalibrationConfig
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.tools.calibration.recording import Recording, read_recording
from horizon_sensor_ros.tools.calibration.text import (
    calibration_text,
    corrected_parameters,
    lenses_text,
    untold,
)
from horizon_sensor_ros.tools.command_errors import CommandError, UsageError
from horizon_sensor_ros.tools.output_files import check_place, written_whole

_MAX_INTERVAL_S = 1e6
# Above so much scatter no planet's figure is to blame.
_BLUNDER = 100.0
_WRONG_ROTATIONS = (
    "; do the rotations belong to these cameras: topics swapped, the inverse of a rotation, "
    "w before x, a picture upside down?"
)
# A sphere in place of an ellipsoid may look like another lens, too.
_WRONG_LENSES = (
    "; set their camera_info right, or give --focal, which finds focal lengths together with "
    "mountings; over a flattened planet set planet: wgs84 before that"
)
_HINTS = {
    Status.POOR_FIT: "; over a flattened planet set planet: wgs84 and have coarse_pose in the bag, "
    "for a misalignment that grows give --drift, and see that lenses and stamps are right",
    Status.ILL_CONDITIONED: "; let the craft roll and pitch while recording, and where planet is "
    "wgs84 have coarse_pose in the bag",
}


def calibrate_bag(arguments: argparse.Namespace, stopped: Callable[[], bool]) -> str:
    """Do what the command line asks for and return what was written.

    Prints the table. Raises CommandError, saying why there is no calibration, and KeyboardInterrupt
    soon after `stopped` says so; nothing is then written.
    """
    _check_outputs(arguments)
    if not 0.0 <= arguments.interval <= _MAX_INTERVAL_S:
        raise UsageError(
            f"--interval must be 0 to {_MAX_INTERVAL_S:g} s, got {arguments.interval:g}"
        )
    try:
        config = CalibrationConfig(
            arguments.drift, arguments.focal, arguments.max_sigma, arguments.correlation
        )
    except ValueError as error:
        # It names the one that is wrong by its field.
        option = "--max-sigma" if str(error).startswith("max_sigma") else "--correlation"
        raise UsageError(f"{option}: {error}") from None
    recording = read_recording(arguments, stopped)
    cameras = list(recording.rot_base_from_cam)
    lenses = lens_blurs(recording.sets, cameras, config.correlation_s)
    if arguments.lenses:
        calibration = None
        if not any(lens.observed for lens in lenses):
            why_not = "; ".join(f"{lens.camera}: {lens.why_not}" for lens in lenses)
            raise CommandError(f"no lens is told. {why_not}. {recording.summary}")
        print(lenses_text(lenses, recording))
    else:
        calibration = _calibrated(recording, config)
        print(calibration_text(calibration, lenses, recording))
    places = [path for path in (arguments.out, arguments.picture) if path is not None]
    text = ""
    if arguments.out is not None:
        text = corrected_parameters(
            arguments.params, calibration, recording.sphere, untold(lenses, recording)
        )
    # Both or neither.
    with written_whole(*places) as fresh:
        beside = dict(zip(places, fresh, strict=True))
        if arguments.out is not None:
            beside[arguments.out].write_text(text, encoding="utf-8")
        if arguments.picture is not None:
            from horizon_sensor_ros.tools.calibration.figure import draw_calibration  # noqa: PLC0415

            assert calibration is not None  # no --picture with --lenses
            draw_calibration(beside[arguments.picture], calibration, recording.rot_base_from_cam)
    return "\n".join(f"written: {path}" for path in places)


def _calibrated(recording: Recording, config: CalibrationConfig) -> Calibration:
    """The mountings that a recording tells; CommandError where it tells none."""
    nominal, sphere = recording.rot_base_from_cam, recording.sphere
    calibration = calibrate(recording.sets, nominal, sphere, config)
    calibration = with_lenses_checked(calibration, nominal, sphere, config)
    if not calibration.ok:
        hint = _HINTS.get(calibration.status, "")
        if calibration.status is Status.TOO_FEW_POINTS:
            hint = f"; {recording.hint}"
        elif calibration.wrong_lenses:
            hint = _WRONG_LENSES
        elif calibration.scatter > _BLUNDER:
            hint = _WRONG_ROTATIONS
        told = f"no calibration: {calibration.reason}{hint}"
        raise CommandError(f"{told}{'' if told.endswith('?') else '.'} {recording.summary}")
    return calibration


def _check_outputs(arguments: argparse.Namespace) -> None:
    """CommandError where one of the files could not be written after all the work."""
    for name in ("out", "picture"):
        path: Path | None = getattr(arguments, name)
        if path is None:
            continue
        if path.exists() and not arguments.force:
            raise CommandError(f"--{name}: {path} exists; choose another, or --force to replace it")
        try:
            check_place(path)
        except CommandError as error:
            raise CommandError(f"--{name}: {error}; choose another place") from None
    if arguments.picture is not None:
        from horizon_sensor_ros.tools.calibration.figure import check_picture  # noqa: PLC0415

        check_picture(arguments.picture)
