"""Quality of service that parameters may override."""

from __future__ import annotations

import re
from collections.abc import Mapping
from copy import copy
from typing import Any

from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

from horizon_sensor_ros.ros.parameters.parameter import Parameter

_OVERRIDE = re.compile(r"qos_overrides\..+\.(?:publisher|subscription)\.(\w+)")
_CHOICES = {
    "history": ("system_default", "keep_last", "keep_all"),
    "reliability": ("system_default", "reliable", "best_effort", "best_available"),
}
_MAX_DEPTH = 2**31 - 1  # of DDS


def overridable(qos: QoSProfile) -> dict[str, Any]:
    """Arguments of a publisher or subscription with this profile, where no parameter says another.

    rclpy writes overrides into the profile it is given: they must not reach other topics.
    """
    return {
        "qos_profile": copy(qos),
        "qos_overriding_options": QoSOverridingOptions.with_default_policies(),
    }


def check_overrides(values: Mapping[str, Any]) -> None:
    """Raise ParameterError where a parameter overrides a policy with what it cannot be.

    The middleware, which would be given it, complains in many lines that do not name the parameter.
    """
    for name, value in values.items():
        found = _OVERRIDE.fullmatch(name)
        policy = found[1] if found else ""
        if policy == "depth":
            Parameter(name, "integer", None, "", minimum=0, maximum=_MAX_DEPTH).accept(value)
        elif policy in _CHOICES:
            # rclpy takes capitals too.
            given = value.lower() if isinstance(value, str) else value
            Parameter(name, "string", None, "", choices=_CHOICES[policy]).accept(given)
