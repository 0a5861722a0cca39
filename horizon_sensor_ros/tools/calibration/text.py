"""A calibration as a table for a person and as a parameter file for the nodes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import yaml

from horizon_sensor_ros.core.attitude import quaternion_from_rotation
from horizon_sensor_ros.core.horizon_config import HorizonConfig
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.rigid import vector_from_rotation
from horizon_sensor_ros.core.self_calibration.differences import nadir_differences
from horizon_sensor_ros.core.self_calibration.result import Calibration
from horizon_sensor_ros.ros.parameters.ros_yaml import PARAMETERS, read_ros_yaml, ros_scalar

_BLUNDER_RAD = np.radians(5.0)
# Residuals of sets, over what is claimed, and the share of sets that have no say, that are said.
_MUCH_SCATTER, _MANY_OUT = 1.5, 0.1


def calibration_text(
    calibration: Calibration, nominal: Mapping[str, np.ndarray], told: HorizonConfig, summary: str
) -> str:
    """Return the table of what was found, and what was not, for a person.

    told : planet and lenses, as they are told.
    """
    used, sets = int(calibration.used.sum()), len(calibration.sets)
    length_s = 2.0 * calibration.half_time_s
    lines = [
        summary,
        f"{sets} frame sets over {length_s:.0f} s can be compared; {sets - used} do not fit the "
        f"others and have no say. Scatter: {calibration.scatter:.2f} of what the limbs claim.",
        "",
        f"{'':34}{'value':>12}{'sigma':>12}  {'unit':9}observed",
    ]
    lines += _rows(calibration)
    lines += ["", "Not observed, and left as it is:"]
    lines += [f"  - {sentence}" for sentence in calibration.not_observed] or ["  - nothing"]
    lines += ["", "Nadirs apart, RMS (deg): before, after"]
    before = nadir_differences(calibration.sets, nominal)
    after = nadir_differences(calibration.sets, calibration.rot_base_from_cam)
    for one, other in zip(before, after, strict=True):
        was, remains = np.degrees(one.rms_rad), np.degrees(other.rms_rad)
        lines.append(f"  {one.name}: {was:.4f}, {remains:.4f}")
    lines += _cautions(calibration, told)
    lines += _blunders(calibration, nominal)
    return "\n".join(lines)


def _cautions(calibration: Calibration, told: HorizonConfig) -> list[str]:
    """What the sigmas do not hold."""
    found = []
    if calibration.unknowns.focal:
        found.append("Focal lengths are not written: an error of theirs belongs into camera_info.")
    elif told.lens_sigma_px == 0.0:
        found.append(
            "Lenses are taken as exact: the limbs show no error of focal length beyond doubt, but "
            "0.3 %, which they\nmay not show under haze, moves the values by some 0.04 deg. "
            "lens_sigma puts it into the sigmas."
        )
    if calibration.scatter > _MUCH_SCATTER:
        found.append(
            f"The sets scatter {calibration.scatter:.1f} times as much as their limbs claim: the "
            "planet's figure, a lens, or\nstamps are not as told, and may have moved the values by "
            "more than their sigmas."
        )
    times = np.array([each.time_s for each in calibration.sets])
    out = times[~calibration.used]
    if len(out) > _MANY_OUT * len(times):
        found.append(
            f"{len(out)} sets have no say, between {out.min() - times.min():.0f} and "
            f"{out.max() - times.min():.0f} s from the first: did something move then? The\nvalues "
            "are those of the others."
        )
    planet = told.planet
    earth = Planet.wgs84()
    off_m = abs(planet.radius_m - earth.mean_radius_m)
    if planet.flattening == 0.0 and off_m < earth.radius_m * earth.flattening:
        found.append(
            "The planet was a sphere. The Earth is flattened, which turns cameras against each "
            "other by up to\n0.1 deg, and no sigma here holds that: for it planet: wgs84, with "
            "coarse_pose in the bag."
        )
    return [f"\n{caution}" for caution in found]


def _blunders(calibration: Calibration, nominal: Mapping[str, np.ndarray]) -> list[str]:
    """What is to be said of turns that no mounting is wrong by."""
    turned = {
        name: np.linalg.norm(vector_from_rotation(rotation @ nominal[name].T))
        for name, rotation in calibration.rot_base_from_cam.items()
    }
    return [
        f"\nNo misalignment: {name} would be turned by {np.degrees(angle):.0f} deg. The wrong "
        "camera's topic or rotation, the\ninverse of it, w before x, a picture upside down? The "
        "cameras now agree, and may all be wrong\nin the base frame: set that right first."
        for name, angle in turned.items()
        if angle > _BLUNDER_RAD
    ]


def _rows(calibration: Calibration) -> list[str]:
    rows = []
    per_hour = 3600.0 / max(calibration.half_time_s, 1e-9)
    for index, unknown in enumerate(calibration.unknowns.all):
        share = calibration.observed(index)
        if share == "no" and unknown.kind == "limb_height":
            continue
        factor, unit, digits = {
            "rotation": (np.degrees(1.0), "deg", 4),
            "drift": (np.degrees(1.0) * per_hour, "deg/h", 4),
            "focal": (100.0, "%", 4),
            "limb_height": (1.0, "m", 0),
        }[unknown.kind]
        value, sigma = factor * calibration.values[index], factor * calibration.sigmas[index]
        shown = (
            f"{'-':>12}{'-':>12}"
            if share == "no"
            else f"{value:>+12.{digits}f}{sigma:>12.{digits}f}"
        )
        rows.append(f"{unknown.name:34}{shown}  {unit:9}{share}")
    return rows


def corrected_parameters(source: Path | None, calibration: Calibration, sphere: Planet) -> str:
    """Return a ROS parameter file: the source's parameters with the rotations that were found.

    The rotations stand under `/**` and nowhere else, so that every node gets them; what else is
    told of a camera stays. A limb height is set where it was observed.
    """
    # As ROS reads them: what is text to YAML may be a number to it.
    sections = {} if source is None else read_ros_yaml(source).sections
    found = {
        camera: [float(v) for v in quaternion_from_rotation(rot)]
        for camera, rot in calibration.rot_base_from_cam.items()
    }
    (height,) = calibration.unknowns.where("limb_height")
    has_height = calibration.observed(int(height)) == "yes"
    for block in sections.values():
        for camera in found:
            block.pop(f"{camera}.rotation", None)
        if has_height:
            block.pop("limb_height", None)
    everywhere = sections.setdefault("/**", {})
    for camera, quaternion in found.items():
        everywhere[f"{camera}.rotation"] = quaternion
    if has_height:
        everywhere["limb_height"] = float(sphere.limb_height_m + calibration.values[height])
    # A section that is empty by now is none to ROS.
    content = {pattern: {PARAMETERS: block} for pattern, block in sections.items() if block}
    comment = "# Rotations by horizon_self_calibration"
    comment += ", in the middle of the recording.\n" if calibration.unknowns.drift else ".\n"
    return comment + yaml.dump(content, Dumper=_Dumper, sort_keys=False, default_flow_style=None)


class _Dumper(yaml.SafeDumper):
    """Quotes the texts that ROS would take for something else."""

    def represent_text(self, text: str) -> yaml.ScalarNode:
        style = None if isinstance(ros_scalar(text), str) else "'"
        return self.represent_scalar("tag:yaml.org,2002:str", text, style)


_Dumper.add_representer(str, _Dumper.represent_text)
