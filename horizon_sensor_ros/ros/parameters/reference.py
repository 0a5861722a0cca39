"""The reference of all parameters: a table, and a file with the defaults."""

from __future__ import annotations

from typing import Any

from horizon_sensor_ros.ros.parameters.camera import OF_A_CAMERA
from horizon_sensor_ros.ros.parameters.common import NODES_PARAMETER
from horizon_sensor_ros.ros.parameters.horizon import CAMERAS, HORIZON_PARAMETERS
from horizon_sensor_ros.ros.parameters.parameter import Parameter
from horizon_sensor_ros.ros.parameters.target import target_parameters

# Examples of what else a camera may be given.
_OF_ONE_CAMERA = (
    "mask: package://my_craft/config/camera_1_mask.png",
    "gamma: 2.2",
    "readout: 0.02",
    "exposure: 0.01",
    "corner_blur: 0.3",
)


def parameter_reference() -> str:
    """Return the table of all parameters, Markdown, for the documentation."""
    lines = ["| parameter | default | what |", "|---|---|---|"]
    camera = tuple(of("camera_N") for of in OF_A_CAMERA)
    for parameter in (*HORIZON_PARAMETERS, *camera, *target_parameters(), NODES_PARAMETER):
        default = "none" if parameter.default is None else f"`{_yaml_value(parameter.default)}`"
        unit = f" {parameter.unit}" if parameter.unit else ""
        values = parameter.range_text.replace("|", r"\|")
        facts = [f"{values}{unit}" if values else "", "live" if parameter.live else ""]
        known = ", ".join(fact for fact in facts if fact)
        text = parameter.description.replace("<", r"\<") + (f" *{known}*" if known else "")
        lines.append(f"| `{parameter.name}` | {default}{unit} | {text} |")
    return "\n".join(lines) + "\n"


def parameter_file() -> str:
    """Return a parameter file with every parameter at its default, unit and range in a comment."""
    lines = [
        "# Every parameter of the nodes; the same file serves horizon_replay --params.",
        "/**:",
        "  ros__parameters:",
    ]
    for parameter in (*HORIZON_PARAMETERS, *target_parameters(), NODES_PARAMETER):
        lines += _comment(parameter)
        lines.append(f"    {parameter.name}: {_yaml_value(parameter.default)}")
        if parameter is CAMERAS:
            for of in OF_A_CAMERA:
                named = of("camera_N")
                lines += _comment(named, f"{named.name}: ")
            lines += ["", "    # Rotations have no default: set that of every camera that is used."]
            for camera in parameter.default:  # type: ignore[union-attr]
                lines += [f"    # {camera}:", "    #   rotation: [0.0, 0.0, 0.0, 1.0]"]
                # One block a camera, of which lines are uncommented: YAML takes no second one.
                lines += [f"    #   {each}" for each in _OF_ONE_CAMERA if camera == "camera_1"]
    return "\n".join(lines) + "\n"


def _comment(parameter: Parameter, start: str = "") -> list[str]:
    facts = [parameter.unit, parameter.range_text, "live" if parameter.live else "read-only"]
    text = f"{start}{parameter.description} [{'; '.join(fact for fact in facts if fact)}]"
    lines, line = [""], "    #"
    for word in text.split():
        if len(line) + 1 + len(word) > 100:
            lines.append(line)
            line = "    #"
        line += f" {word}"
    return [*lines, line]


def _yaml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return f"[{', '.join(_yaml_value(item) for item in value)}]"
    return '""' if value == "" else str(value)
