"""Whether the frame sets agree with the focal lengths that they were told.

A wrong focal length moves a camera's horizon by what depends on where in the frame it lies. Held
fixed it goes into the mountings, far beyond their sigmas, and under haze no scatter shows it; left
free it comes out, with a sigma of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.self_calibration.adjustment import calibrate
from horizon_sensor_ros.core.self_calibration.result import Calibration, CalibrationConfig
from horizon_sensor_ros.core.status import Status

# An error of a focal length, and what it moves mountings by, in sigmas of either.
_BEYOND_DOUBT, _TOO_FAR = 5.0, 3.0
# Less certain than what is to be told of mountings an error may still be certain enough to be one.
_LESS_CERTAIN = 10.0


def with_lenses_checked(
    calibration: Calibration,
    nominal: Mapping[str, np.ndarray],
    planet: Planet,
    config: CalibrationConfig,
) -> Calibration:
    """The calibration, but none (POOR_FIT) where its sets contradict the lenses.

    That is where with focal lengths free one of them comes out wrong beyond doubt, and mountings
    otherwise by more than their sigmas allow. Of sets that scatter too much the reason says so of
    the lenses, too. nominal, planet, config : as of `calibrate`. With ``config.focal``, or without
    `CameraHorizon.focal_slope`, nothing is checked.
    """
    if config.focal or not (calibration.ok or np.isfinite(calibration.scatter)):
        return calibration
    open_ = replace(config, focal=True, max_sigma=_LESS_CERTAIN * config.max_sigma)
    free = calibrate(calibration.sets, nominal, planet, open_)
    if not free.ok:
        return calibration
    wrong = _wrong_lenses(free)
    if not wrong:
        return calibration
    cameras, said = tuple(wrong), " and ".join(wrong.values())
    if not calibration.ok:
        reason = f"{calibration.reason}, and show {said}"
        return replace(calibration, reason=reason, wrong_lenses=cameras)
    moved = _turns(free) - _turns(calibration)
    sigmas = np.concatenate([calibration.sigmas[i] for i in _rotations(calibration)])
    if not (np.abs(moved) > _TOO_FAR * sigmas).any():
        return calibration
    most_deg = np.degrees(np.abs(moved[np.isfinite(sigmas)]).max())
    reason = f"the limbs show {said}: mountings would be wrong by up to {most_deg:.2g} deg"
    none = Calibration.none(
        Status.POOR_FIT, reason, calibration.unknowns, nominal, calibration.sets
    )
    return replace(none, wrong_lenses=cameras)


def _wrong_lenses(free: Calibration) -> dict[str, str]:
    """Of cameras whose focal length is not as told, beyond doubt: by how much, in words."""
    found = {}
    for camera in free.unknowns.cameras:
        (index,) = free.unknowns.where("focal", camera)
        error, sigma = float(free.values[index]), float(free.sigmas[index])
        if free.observed(int(index)) == "yes" and abs(error) > _BEYOND_DOUBT * sigma:
            how = "shorter" if error < 0.0 else "longer"
            found[camera] = (
                f"{camera}'s focal length {100.0 * abs(error):.2f} % {how} than it is told to be "
                f"(sigma {100.0 * sigma:.2f} %)"
            )
    return found


def _rotations(calibration: Calibration) -> list[np.ndarray]:
    unknowns = calibration.unknowns
    return [unknowns.where("rotation", camera) for camera in unknowns.cameras]


def _turns(calibration: Calibration) -> np.ndarray:
    return np.concatenate([calibration.values[i] for i in _rotations(calibration)])
