"""Quality of service that parameters may override."""

from __future__ import annotations

from copy import copy
from typing import Any

from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions


def overridable(qos: QoSProfile) -> dict[str, Any]:
    """Arguments of a publisher or subscription with this profile, where no parameter says another.

    rclpy writes overrides into the profile it is given: they must not reach other topics.
    """
    return {
        "qos_profile": copy(qos),
        "qos_overriding_options": QoSOverridingOptions.with_default_policies(),
    }
