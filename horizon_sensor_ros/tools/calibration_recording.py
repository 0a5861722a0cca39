"""The frame sets of a bag, each camera's horizon found in its own frame alone.

Alone, because a common fit would take the second camera's limb for a wrong one as soon as the
cameras do not sit as the parameters say.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from tqdm import tqdm

from horizon_sensor_ros.core.attitude import rotation_from_quaternion
from horizon_sensor_ros.core.fits.maximum_likelihood import AltitudeMeasurement
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.self_calibration.measurement import (
    CameraHorizon,
    FrameSet,
    NadirReference,
    camera_horizon,
)
from horizon_sensor_ros.ros.horizon_pipeline import HorizonPipeline
from horizon_sensor_ros.ros.messages import Refusal, stamp_ns
from horizon_sensor_ros.ros.pairing import Pairing
from horizon_sensor_ros.ros.parameters import (
    HorizonSettings,
    ParameterError,
    PipelineSettings,
    horizon_settings,
    read_parameter_file,
)
from horizon_sensor_ros.tools.bag_errors import BagError
from horizon_sensor_ros.tools.input_bag import bag_messages, open_bag
from horizon_sensor_ros.tools.reference_topics import (
    ALTITUDE_TYPES,
    NADIR_TYPES,
    Series,
    altitude_of,
    nadir_of,
)
from horizon_sensor_ros.tools.replayed_node import TopicNames

_IMAGE = ("sensor_msgs/msg/Image",)
_CAMERA_INFO = ("sensor_msgs/msg/CameraInfo",)
# Any horizon node's parameters will do: the rotations are the same in both.
_NODE = "attitude_node"
# Between two messages of another instrument farther apart nothing is known.
_MAX_GAP_NS = 2_000_000_000


@dataclass(frozen=True, eq=False)
class Recording:
    """What a bag holds for self-calibration; summary says what was read, for a person."""

    sets: tuple[FrameSet, ...]
    rot_base_from_cam: Mapping[str, np.ndarray]
    sphere: Planet
    summary: str


class _Horizons:
    """Pairs images first, then finds the horizon in each image of a set alone."""

    def __init__(self, settings: PipelineSettings, interval_ns: int, *, focal: bool) -> None:
        self._focal = focal
        self._interval = interval_ns
        self._next: int | None = None
        planet = settings.sensor.planet
        self.sphere = Planet(planet.mean_radius_m, planet.limb_height_m)
        self._pairing: Pairing[Any] = Pairing(settings.cameras, settings.slop_ns)
        self._alone = {
            camera: HorizonPipeline(replace(settings, cameras=(camera,), rotations=(rotation,)))
            for camera, rotation in zip(settings.cameras, settings.rotations, strict=True)
        }
        self.sets: list[tuple[int, tuple[CameraHorizon, ...]]] = []

    def on_camera_info(self, camera: str, msg: Any) -> None:
        """Take a camera's calibration."""
        self._alone[camera].on_camera_info(camera, msg)

    def on_image(self, camera: str, msg: Any) -> None:
        """Take an image."""
        stamp = stamp_ns(msg)
        if isinstance(stamp, Refusal):
            return
        for members in self._pairing.push(camera, stamp, msg).sets:
            first = members[0][0]
            if self._next is not None and 0 <= self._next - first < self._interval:
                continue
            self._next = first + self._interval
            images = zip(self._alone.items(), members, strict=True)
            found = [self._horizon(name, alone, image) for (name, alone), (_, image) in images]
            self.sets.append((first, tuple(h for h in found if h is not None)))

    def _horizon(self, camera: str, alone: HorizonPipeline, msg: Any) -> CameraHorizon | None:
        for result in alone.on_image(camera, msg).results:
            view = result.frames[0].view
            return camera_horizon(view, result.fix, self.sphere, focal=self._focal)
        return None

    def summary(self) -> str:
        """Return what was read, for a person."""
        lines = [f"{len(self.sets)} frame sets"]
        for camera, alone in self._alone.items():
            causes = "".join(f", {cause}: {n}" for cause, n in sorted(alone.rejected.items()))
            lines.append(f"{camera}: {alone.counts['fixes']} horizons{causes}")
        return "; ".join(lines)


@dataclass(frozen=True)
class _Listener:
    """What becomes of a topic's messages, and which types of them will do."""

    types: tuple[str, ...]
    take: Callable[[Any, str], None]


def read_recording(arguments: argparse.Namespace, stopped: Callable[[], bool]) -> Recording:
    """Read the bag that the command line names; BagError says why it cannot be used."""
    settings = _settings(arguments)
    pipeline = settings.pipeline
    names = TopicNames(arguments.namespace, arguments.remap)
    horizons = _Horizons(pipeline, round(arguments.interval * 1e9), focal=arguments.focal)
    listeners: dict[str, _Listener] = {}
    for camera in pipeline.cameras:
        take_image, take_info = (
            partial(_without_type, partial(take, camera))
            for take in (horizons.on_image, horizons.on_camera_info)
        )
        listeners[names(f"{camera}/image_raw")] = _Listener(_IMAGE, take_image)
        listeners[names(f"{camera}/camera_info")] = _Listener(_CAMERA_INFO, take_info)
    altitudes, nadirs = Series(_MAX_GAP_NS), Series(_MAX_GAP_NS)
    altitude_m = _number(arguments.altitude)
    if arguments.altitude is not None and altitude_m is None:
        find = partial(altitude_of, planet=horizons.sphere)
        topic = names(arguments.altitude)
        listeners[topic] = _Listener(ALTITUDE_TYPES, _into(altitudes, topic, lambda m, _: find(m)))
    if arguments.reference is not None:
        topic = names(arguments.reference)
        down = partial(nadir_of, level_z=settings.level_z)
        listeners[topic] = _Listener(NADIR_TYPES, _into(nadirs, topic, down))
    _read(arguments.in_bag, listeners, stopped)

    def altitude_at(stamp: int) -> AltitudeMeasurement | None:
        if arguments.altitude is None:
            return None
        known = altitudes.at(stamp) if altitude_m is None else np.array([altitude_m])
        return None if known is None else AltitudeMeasurement(float(known[0]), sigma_m)

    def reference_at(stamp: int) -> NadirReference | None:
        nadir = nadirs.at(stamp)
        if nadir is None:
            return None
        return NadirReference(nadir / np.linalg.norm(nadir), np.radians(sigma_deg))

    sigma_m, sigma_deg = arguments.altitude_sigma, arguments.reference_sigma
    found = sorted(horizons.sets, key=lambda each: each[0])
    start = found[0][0] if found else 0
    return Recording(
        tuple(
            FrameSet((stamp - start) * 1e-9, seen, altitude_at(stamp), reference_at(stamp))
            for stamp, seen in found
        ),
        {
            camera: rotation_from_quaternion(np.array(quaternion))
            for camera, quaternion in zip(pipeline.cameras, pipeline.rotations, strict=True)
        },
        horizons.sphere,
        horizons.summary(),
    )


def _settings(arguments: argparse.Namespace) -> HorizonSettings:
    for name in ("altitude_sigma", "reference_sigma"):
        if not 0.0 < getattr(arguments, name) < np.inf:
            option = name.replace("_", "-")
            raise BagError(f"--{option} must be positive, got {getattr(arguments, name)}")
    try:
        values = (
            {}
            if arguments.params is None
            else read_parameter_file(arguments.params, _NODE, arguments.namespace)
        )
        settings = horizon_settings(values)
    except ParameterError as error:
        hint = "" if arguments.params else "; give the rotations to be corrected with --params FILE"
        raise BagError(f"{error}{hint}") from None
    cameras = settings.pipeline.cameras
    if None in settings.pipeline.rotations:
        raise BagError("extrinsics_source is tf; set the rotations to be corrected as parameters")
    if len(cameras) < 2 and arguments.reference is None:
        raise BagError(
            f"{cameras[0]} is the only camera and has nothing to be compared with; give "
            "--reference TOPIC with the attitude from elsewhere"
        )
    return settings


def _number(text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return None


def _without_type(take: Callable[[Any], None], msg: Any, _msgtype: str) -> None:
    take(msg)


def _into(
    series: Series, topic: str, find: Callable[[Any, str], np.ndarray | float | None]
) -> Callable[[Any, str], None]:
    """Put what is found in a topic's messages into a series, by their stamps."""

    def take(msg: Any, msgtype: str) -> None:
        stamp = stamp_ns(msg)
        try:
            value = find(msg, msgtype)
        except BagError as error:
            raise BagError(f"{topic}: {error}") from None
        if value is not None and not isinstance(stamp, Refusal):
            series.add(stamp, value)

    return take


def _read(path: Path, listeners: Mapping[str, _Listener], stopped: Callable[[], bool]) -> None:
    """Hand every message that somebody listens to over, in the bag's order."""
    typestore = get_typestore(Stores.ROS2_JAZZY)
    reader = open_bag(path)
    try:
        wanted = [
            c
            for c in reader.connections
            if c.topic in listeners and c.msgtype in listeners[c.topic].types
        ]
        missing = sorted(set(listeners) - {c.topic for c in wanted})
        if missing:
            looked_for = "\n".join(
                f"  {topic} ({' or '.join(listeners[topic].types)})" for topic in missing
            )
            there = "\n".join(sorted(f"  {c.topic} ({c.msgtype})" for c in reader.connections))
            raise BagError(
                f"{path} has not:\n{looked_for}\nIt has:\n{there}\n"
                "Name topics with --remap FROM:=TO, cameras with the parameter `cameras`."
            )
        total = sum(c.msgcount for c in wanted)
        with tqdm(bag_messages(reader, wanted), total=total, unit="msg", file=sys.stderr) as all_:
            for connection, _, raw in all_:
                if stopped():
                    raise KeyboardInterrupt
                try:
                    msg = typestore.deserialize_cdr(raw, connection.msgtype)
                except SerdeError:
                    continue
                listeners[connection.topic].take(msg, connection.msgtype)
    finally:
        reader.close()
