"""What a person may do about topics that a bag lacks."""

from __future__ import annotations

from collections.abc import Iterable

from horizon_sensor_ros.ros.messages.message_types import CAMERA_INFO, COMPRESSED_IMAGE, IMAGE
from horizon_sensor_ros.tools.bags.input_bag import InputBag


def advice(missing: Iterable[tuple[str, str]], spare: Iterable[tuple[str, str]]) -> list[str]:
    """Return lines of advice, none where the bag has nothing that would help.

    missing : topics that are looked for, each with its type. spare : the bag's others.
    """
    missing, spare = set(missing), set(spare)
    lines = []
    compressed = sorted(topic for topic, kind in spare if kind == COMPRESSED_IMAGE)
    if compressed and any(kind == IMAGE for _, kind in missing):
        lines.append(
            "Compressed images are read where they are named NAME/compressed, as by "
            f"image_transport: not {', '.join(compressed)}."
        )
    wrongly_named = {kind for _, kind in missing} & {kind for _, kind in spare}
    if wrongly_named & {IMAGE, CAMERA_INFO}:
        lines.append(
            "Other names: --remap FROM:=TO for each topic, or the cameras' names in the "
            "parameter `cameras`."
        )
    elif wrongly_named:
        lines.append("Other names: --remap FROM:=TO.")
    return lines


def lacking(topic: str, kind: str, bag: InputBag) -> str:
    """That a bag has not a topic with a type, and with which other one it has it."""
    others = [c.msgtype for c in bag.connections if c.topic == topic]
    other = f", but {topic} ({', '.join(others)})" if others else ""
    return f"{bag.path} has no {topic} ({kind}){other}"


def of_other_types(helping: Iterable[tuple[str, str]], bag: InputBag) -> list[str]:
    """Which topics that help, each with its type, a bag has with another type only."""
    topics = {c.topic for c in bag.connections}
    present = {(c.topic, c.msgtype) for c in bag.connections}
    return [
        lacking(topic, kind, bag)
        for topic, kind in helping
        if topic in topics and (topic, kind) not in present
    ]
