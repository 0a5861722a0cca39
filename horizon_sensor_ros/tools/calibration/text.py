"""A calibration as a table for a person and as a parameter file for the nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from horizon_sensor_ros.core.mathematics.attitude import quaternion_from_rotation
from horizon_sensor_ros.core.mathematics.rigid import vector_from_rotation
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.self_calibration.corner_blur import LensBlur
from horizon_sensor_ros.core.self_calibration.differences import nadir_differences
from horizon_sensor_ros.core.self_calibration.result import Calibration
from horizon_sensor_ros.ros.parameters.ros_yaml import PARAMETERS, read_ros_yaml, ros_scalar
from horizon_sensor_ros.tools.calibration.recording import Recording

_BLUNDER_RAD = np.radians(5.0)
# Residuals of sets, over what is claimed, and the share of sets that have no say, that are said.
_MUCH_SCATTER, _MANY_OUT = 1.5, 0.1
_SURPRISE = 3.0  # sigmas of a lens's blur off what is told of it
_SOFT_PX = 0.1  # of it, from where on what is told of it may be wrong by enough to be said
_DIGITS = 4  # of that blur, in a parameter file
# What to do about a lens that blurs more in its corners: for the mountings, and where these were
# not asked for.
_AGAIN = (
    ", and the\nmountings by them: run this again with the file that --out writes, in which that "
    "is told."
)
_WRITTEN = ": the\nfile that --out writes tells it."
_HEAD = f"{'':34}{'value':>12}{'sigma':>12}  {'unit':9}observed"


def calibration_text(
    calibration: Calibration, lenses: Sequence[LensBlur], recording: Recording
) -> str:
    """Return the table of what was found of a recording, and what was not, for a person."""
    nominal = recording.rot_base_from_cam
    used, sets = int(calibration.used.sum()), len(calibration.sets)
    length_s = 2.0 * calibration.half_time_s
    lines = [
        recording.summary,
        f"{sets} frame sets over {length_s:.0f} s can be compared; {sets - used} do not fit the "
        f"others and have no say. Scatter: {calibration.scatter:.2f} of what the limbs claim.",
        "",
        _HEAD,
    ]
    lines += _rows(calibration) + _rows_of_lenses(lenses)
    lines += ["", "Not observed, and left as it is:"]
    lines += [f"  - {sentence}" for sentence in calibration.not_observed] or ["  - nothing"]
    lines += _not_told(lenses)
    lines += ["", "Nadirs apart, RMS (deg): before, after"]
    before = nadir_differences(calibration.sets, nominal)
    after = nadir_differences(calibration.sets, calibration.rot_base_from_cam)
    for one, other in zip(before, after, strict=True):
        was, remains = np.degrees(one.rms_rad), np.degrees(other.rms_rad)
        lines.append(f"  {one.name}: {was:.4f}, {remains:.4f}")
    lines += _cautions(calibration, recording)
    lines += _surprises(lenses, recording, _AGAIN)
    lines += _blunders(calibration, nominal)
    return "\n".join(lines)


def _cautions(calibration: Calibration, recording: Recording) -> list[str]:
    """What the sigmas do not hold."""
    found = []
    told = recording.told
    if calibration.unknowns.focal:
        found.append("Focal lengths are not written: an error of theirs belongs into camera_info.")
    elif told.lens_sigma_px == 0.0:
        found.append(
            "Lenses are taken as exact: the limbs show no error of focal length beyond doubt, but "
            "0.3 %, which they\nmay not show under haze, moves the values by some 0.04 deg. "
            "lens_sigma puts it into the sigmas."
        )
    soft = [name for name, blur in recording.corner_blur_px.items() if (blur or 0.0) > _SOFT_PX]
    if soft:
        found.append(
            f"The lens of {' and '.join(soft)} blurs more in its corners: what is told of that is "
            "not all of it, and by\nwhat is left the values may be wrong beyond their sigmas: of "
            "0.25 px by 0.04 deg about nadir."
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


def lenses_text(lenses: Sequence[LensBlur], recording: Recording) -> str:
    """Return the same of how lenses blur, and of nothing else."""
    lines = [recording.summary, "", _HEAD, *_rows_of_lenses(lenses)]
    lines += _not_told(lenses) + _surprises(lenses, recording, _WRITTEN)
    return "\n".join(lines)


def _not_told(lenses: Sequence[LensBlur]) -> list[str]:
    said = [f"  - {lens.camera}: {lens.why_not}" for lens in lenses if not lens.observed]
    return ["", "Blur in the corners, not told:", *said] if said else []


def _rows_of_lenses(lenses: Sequence[LensBlur]) -> list[str]:
    return [
        f"{f'{lens.camera} blur in the corners':34}{lens.blur_px:>+12.4f}{lens.sigma_px:>12.4f}  "
        f"{'px':9}yes"
        for lens in lenses
        if lens.observed
    ]


def untold(lenses: Sequence[LensBlur], recording: Recording) -> list[LensBlur]:
    """Return the lenses that are observed, and of which the parameters tell nothing."""
    told = recording.corner_blur_px
    return [lens for lens in lenses if lens.observed and told[lens.camera] is None]


def _surprises(lenses: Sequence[LensBlur], recording: Recording, to_do: str) -> list[str]:
    """What is to be said of lenses that are not as they are told, and what to do about it."""
    found = []
    for lens in lenses:
        was = recording.corner_blur_px[lens.camera]
        off_px = lens.blur_px - (was or 0.0)
        if not lens.observed or abs(off_px) < _SURPRISE * lens.sigma_px:
            continue
        if was is None and lens.blur_px < 0.0:
            found.append(
                f"{lens.camera}'s lens blurs {-lens.blur_px:.2f} px less in its corners, which no "
                "parameter tells, and which moved\nits horizons."
            )
        elif was is None:
            found.append(
                f"{lens.camera}'s lens blurs {lens.blur_px:.2f} px more in its corners, which "
                f"moved its horizons{to_do}"
            )
        else:
            found.append(
                f"{lens.camera}.corner_blur is told as {was:.2f} px, and its limbs show "
                f"{lens.blur_px:.2f} +- {lens.sigma_px:.2f} px. It stays as it is told."
            )
    return [f"\n{surprise}" for surprise in found]


def corrected_parameters(
    source: Path | None,
    calibration: Calibration | None,
    sphere: Planet,
    lenses: Sequence[LensBlur] = (),
) -> str:
    """Return a ROS parameter file: the source's parameters with the rotations that were found.

    The rotations stand under `/**` and nowhere else, so that every node gets them; what else is
    told of a camera stays; without a calibration all of it does. A limb height is set where it was
    observed, and how lenses blur in the corners, of those that are given.
    """
    # As ROS reads them: what is text to YAML may be a number to it.
    sections = {} if source is None else read_ros_yaml(source).sections
    mountings = {} if calibration is None else _of_mountings(calibration, sphere)
    blurs = {f"{lens.camera}.corner_blur": max(lens.blur_px, 0.0) for lens in lenses}
    for block in sections.values():
        for name in mountings:
            block.pop(name, None)
        for name in blurs:
            if _is_untold(block.get(name)):
                block.pop(name, None)
    everywhere = sections.setdefault("/**", {})
    everywhere.update(mountings)
    everywhere.update({name: round(blur_px, _DIGITS) for name, blur_px in blurs.items()})
    comment = "# Rotations by horizon_self_calibration"
    if calibration is None:
        comment = "# Blur in the corners by horizon_self_calibration"
    elif calibration.unknowns.drift:
        comment += ", in the middle of the recording"
    # A section that is empty by now is none to ROS.
    content = {pattern: {PARAMETERS: block} for pattern, block in sections.items() if block}
    written = yaml.dump(content, Dumper=_Dumper, sort_keys=False, default_flow_style=None)
    return f"{comment}.\n{written}"


def _of_mountings(calibration: Calibration, sphere: Planet) -> dict[str, Any]:
    """Parameters that a calibration changes."""
    found: dict[str, Any] = {
        f"{camera}.rotation": [float(v) for v in quaternion_from_rotation(rot)]
        for camera, rot in calibration.rot_base_from_cam.items()
    }
    (height,) = calibration.unknowns.where("limb_height")
    if calibration.observed(int(height)) == "yes":
        found["limb_height"] = float(sphere.limb_height_m + calibration.values[height])
    return found


def _is_untold(corner_blur: Any) -> bool:
    """Whether a value of `corner_blur` in a file tells nothing; what is told to another node stays
    where it is.
    """
    return isinstance(corner_blur, int | float) and corner_blur < 0.0


class _Dumper(yaml.SafeDumper):
    """Quotes the texts that ROS would take for something else."""

    def represent_text(self, text: str) -> yaml.ScalarNode:
        style = None if isinstance(ros_scalar(text), str) else "'"
        return self.represent_scalar("tag:yaml.org,2002:str", text, style)


_Dumper.add_representer(str, _Dumper.represent_text)
