"""Quality of service that parameters may override."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
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
_OF_TOPIC = re.compile(r"qos_overrides\.(/.+)\.(?:publisher|subscription)\.\w+")
_NUMBER = re.compile(r"\d+")
_ALIKE = 0.8  # topics are, from here on to 1


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


def misspelt_topics(given: Iterable[str], known: Iterable[str]) -> dict[str, str]:
    """Return which of the given overrides are for no topic, and which topic may have been meant.

    known : those of a node's own publishers and subscriptions. One file serves all nodes: a topic
    that is like none of theirs is another's, and so is one of another number, another camera's.
    """
    topics = sorted({found[1] for found in map(_OF_TOPIC.fullmatch, known) if found})
    shapes = {_NUMBER.sub("", topic) for topic in topics}
    misspelt = {}
    for name in given:
        found = _OF_TOPIC.fullmatch(name)
        if found is None or _NUMBER.sub("", found[1]) in shapes:
            continue
        near = difflib.get_close_matches(found[1], topics, n=1, cutoff=_ALIKE)
        if near:
            misspelt[name] = near[0]
    return misspelt
