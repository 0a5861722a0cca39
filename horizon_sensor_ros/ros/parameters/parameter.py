"""One parameter: what it is called, takes and means."""

from __future__ import annotations

import re
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from horizon_sensor_ros.ros.files.yaml_file import shown

_KIND_WORDS = {
    "string": "a string",
    "double": "a double",
    "integer": "an integer of 64 bits",
    "bool": "true or false",
    "double_array": "a list of numbers",
    "string_array": "a list of strings",
}


Value = bool | int | float | str | list[float] | list[str]


class ParameterError(ValueError):
    """Parameters that no node can run with; the message says which and why, in one line."""


@dataclass(frozen=True)
class Parameter:
    """One parameter.

    kind : string, double, integer, bool, double_array or string_array. default : None has none.
    live : can be set while the node runs; the others are read-only.
    """

    name: str
    kind: str
    default: Value | None
    description: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    live: bool = False

    @property
    def range_text(self) -> str:
        """Allowed values, for a person; empty when any will do."""
        if self.choices:
            return " | ".join(self.choices)
        if self.minimum is not None:
            return f"{self.minimum:g} to {self.maximum:g}"
        return ""

    def accept(self, value: Any) -> Value:
        """Return value as this parameter's kind; ParameterError when it is another or out of range.

        Whole numbers are taken for doubles: `rotation: [0, 0, 0, 1]` is what a person writes.
        """
        accepted = _as_kind(value, self.kind)
        if accepted is None:
            raise ParameterError(
                f"{self.name} must be {_KIND_WORDS[self.kind]}, got {shown(value)}"
            )
        if self.choices and accepted not in self.choices:
            raise ParameterError(
                f"{self.name} must be one of {', '.join(self.choices)}, got {shown(accepted)}"
            )
        if self.minimum is not None and self.maximum is not None:
            number = float(accepted)  # type: ignore[arg-type]
            # Written so that NaN fails.
            if not self.minimum <= number <= self.maximum:
                unit = f" {self.unit}" if self.unit else ""
                raise ParameterError(
                    f"{self.name} must be {self.minimum:g} to {self.maximum:g}{unit}, "
                    f"got {shown(accepted)}"
                )
        return accepted


def accept_all(
    parameters: Sequence[Parameter], values: Mapping[str, Any]
) -> tuple[dict[str, Any], list[str]]:
    """Return values, each as its parameter's kind, and what is wrong with the others."""
    accepted: dict[str, Any] = {}
    problems: list[str] = []
    for parameter in parameters:
        try:
            value = values.get(parameter.name, parameter.default)
            accepted[parameter.name] = parameter.accept(value)
        except ParameterError as error:
            problems.append(str(error))
    return accepted, problems


def with_parameter_names(text: str, fields: Mapping[str, str]) -> str:
    """Return the core's complaint in the names that the user gave.

    fields : field of the core's configuration by the name of its parameter.
    """
    names = {field: name for name, field in fields.items()}
    return re.sub(r"\w+", lambda word: names.get(word[0], word[0]), text)


def _as_kind(value: Any, kind: str) -> Any:
    """Return value as a kind; None when it is another kind."""
    if kind.endswith("_array"):
        # rclpy hands number arrays over as array.array.
        if not isinstance(value, list | tuple | array):
            return None
        items = [_as_kind(item, kind.removesuffix("_array")) for item in value]
        return None if any(item is None for item in items) else items
    if kind == "bool":
        return value if isinstance(value, bool) else None
    if kind == "string":
        return value if isinstance(value, str) else None
    if kind == "integer":
        whole = isinstance(value, int) and not isinstance(value, bool)
        # A ROS integer has 64 bits; those of a file may have any number.
        return value if whole and -(2**63) <= value < 2**63 else None
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value)
    except OverflowError:
        return None
