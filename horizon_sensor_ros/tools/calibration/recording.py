"""The frame sets of a bag, each camera's horizon found in its own frame alone.

Alone, because a common fit would take the second camera's limb for a wrong one as soon as the
cameras do not sit as the parameters say.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from horizon_sensor_ros.core.aiding import AltitudeMeasurement
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.mathematics.attitude import rotation_from_quaternion
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.planet_figure import mean_sphere
from horizon_sensor_ros.core.seconds import ns_from_s, s_from_ns
from horizon_sensor_ros.core.self_calibration.measurement import (
    CameraHorizon,
    FrameSet,
    NadirReference,
    camera_horizon,
)
from horizon_sensor_ros.ros.messages.message_types import CAMERA_INFO, IMAGE, IMU
from horizon_sensor_ros.ros.messages.refusal import Refusal
from horizon_sensor_ros.ros.messages.stamps import stamp_ns
from horizon_sensor_ros.ros.parameters.horizon_settings import HorizonSettings, PipelineSettings
from horizon_sensor_ros.ros.parameters.parameter import ParameterError
from horizon_sensor_ros.ros.pipelines.aiding_sources import COARSE_POSE_TOPIC, IMU_TOPIC
from horizon_sensor_ros.ros.pipelines.horizon_pipeline import HorizonPipeline
from horizon_sensor_ros.ros.pipelines.pairing import Pairing
from horizon_sensor_ros.tools.bags.bag_listening import Listener, listen
from horizon_sensor_ros.tools.bags.replayed_node import TopicNames
from horizon_sensor_ros.tools.command_errors import CommandError, UsageError
from horizon_sensor_ros.tools.horizon_parameters import horizon_values, settings_of_a_node
from horizon_sensor_ros.tools.reference_topics import (
    NADIR_TYPES,
    POSE_TYPES,
    Series,
    altitude_of,
    nadir_of,
)

# Between two messages of another instrument farther apart nothing is known.
_MAX_GAP_NS = 2_000_000_000


@dataclass(frozen=True, eq=False)
class Recording:
    """What a bag holds for self-calibration; summary says what was read, for a person, and hint
    what to do where that is too little. corner_blur_px : as each camera's is told.
    """

    sets: tuple[FrameSet, ...]
    rot_base_from_cam: Mapping[str, np.ndarray]
    told: HorizonConfig
    corner_blur_px: Mapping[str, float | None]
    sphere: Planet
    summary: str
    hint: str


class Horizons:
    """Pairs images first, then finds the horizon in each image of a set alone."""

    def __init__(self, settings: PipelineSettings, interval_ns: int, *, focal: bool) -> None:
        self._focal = focal
        self._interval = interval_ns
        self._next: int | None = None
        self.sphere = mean_sphere(settings.sensor.planet)
        self._lens_sigma_px = settings.sensor.lens_sigma_px
        # What is told of mountings is to be found, and what of lenses is the same in all frames.
        sensor = replace(
            settings.sensor, mounting_sigma_rad=0.0, lens_sigma_px=0.0, limb_height_sigma_m=0.0
        )
        # An altitude that is known goes into the calibration, not into each camera's fit.
        unaided = replace(settings.aiding, pose_altitude_sigma_m=0.0, altitude_sigma_m=0.0)
        self._pairing: Pairing[Any] = Pairing(
            settings.cameras, settings.slop_ns, settings.queue_size
        )
        self._alone = {
            camera.name: HorizonPipeline(
                replace(settings, each=(camera,), aiding=unaided, sensor=sensor)
            )
            for camera in settings.each
        }
        self.unpaired = 0
        self.sets: list[tuple[int, tuple[CameraHorizon, ...]]] = []

    def on_coarse_pose(self, msg: Any) -> None:
        """Take a coarse pose, which an ellipsoid's limb needs."""
        for alone in self._alone.values():
            alone.aiding.on_coarse_pose(msg)

    def on_imu(self, msg: Any) -> None:
        """Take an angular rate, which frames that are read out row by row need."""
        for alone in self._alone.values():
            alone.aiding.on_imu(msg)

    def on_camera_info(self, camera: str, msg: Any) -> None:
        """Take a camera's calibration."""
        self._alone[camera].on_camera_info(camera, msg)

    def on_image(self, camera: str, msg: Any) -> None:
        """Take an image."""
        stamp = stamp_ns(msg)
        if isinstance(stamp, Refusal):
            return
        paired = self._pairing.push(camera, stamp, msg)
        self.unpaired += paired.unpaired
        for members in paired.sets:
            first = members[0][0]
            if self._next is not None and 0 < self._next - first <= self._interval:
                continue
            self._next = first + self._interval
            images = zip(self._alone.items(), members, strict=True)
            found = [self._horizon(name, alone, image) for (name, alone), (_, image) in images]
            self.sets.append((first, tuple(h for h in found if h is not None)))

    def _horizon(self, camera: str, alone: HorizonPipeline, msg: Any) -> CameraHorizon | None:
        for result in alone.on_image(camera, msg).results:
            view = result.frames[0].view
            return camera_horizon(
                view,
                result.fix,
                self.sphere,
                focal=self._focal,
                lens_sigma_px=self._lens_sigma_px,
            )
        return None

    def summary(self) -> str:
        """Return what was read, for a person."""
        lines = [f"{len(self.sets)} frame sets"]
        for camera, alone in self._alone.items():
            causes = "".join(f", {cause}: {n}" for cause, n in sorted(alone.rejected.items()))
            lines.append(f"{camera}: {alone.counts['fixes']} horizons{causes}")
        if self.unpaired:
            lines.append(f"images without a partner within slop: {self.unpaired}")
        return "; ".join(lines)

    @property
    def hint(self) -> str:
        """What to do where too few sets tell something."""
        causes = sum((alone.rejected for alone in self._alone.values()), Counter[str]())
        common, times = causes.most_common(1)[0] if causes else ("", 0)
        fixes = sum(alone.counts["fixes"] for alone in self._alone.values())
        if self.unpaired > max(2 * len(self.sets), times):
            return (
                "the cameras' stamps lie farther apart than slop: raise it, or trigger them at once"
            )
        if times > fixes:
            return f"most images were refused ({common}): doc/tuning.md says what each reason means"
        return "record longer, with the limb in both frames"


class _OtherInstruments:
    """Altitude and nadir from elsewhere, as the command line names them."""

    def __init__(
        self,
        arguments: argparse.Namespace,
        settings: HorizonSettings,
        sphere: Planet,
        names: TopicNames,
    ) -> None:
        self._topics: list[tuple[Listener, Series]] = []
        self._altitudes, self._nadirs = Series(_MAX_GAP_NS), Series(_MAX_GAP_NS)
        self._altitude_m = _number(arguments.altitude)
        self._altitude_sigma_m = arguments.altitude_sigma
        self._nadir_sigma_rad = float(np.radians(arguments.reference_sigma))
        prior = settings.pipeline.aiding
        if arguments.altitude is None and prior.altitude_sigma_m > 0.0:
            self._altitude_m, self._altitude_sigma_m = prior.altitude_m, prior.altitude_sigma_m
        if arguments.altitude is not None and self._altitude_m is None:
            topic = names(arguments.altitude)
            find = partial(altitude_of, planet=sphere)
            take = _into(self._altitudes, topic, lambda msg, _: find(msg))
            self._topics.append((Listener(topic, POSE_TYPES, take), self._altitudes))
        if arguments.reference is not None:
            topic = names(arguments.reference)
            base_frame = settings.pipeline.base_frame
            find_nadir = partial(nadir_of, level_z=settings.level_z, base_frame=base_frame)
            take = _into(self._nadirs, topic, find_nadir)
            self._topics.append((Listener(topic, NADIR_TYPES, take), self._nadirs))
        self.listeners = [listener for listener, _ in self._topics]

    def require(self, stamps: Sequence[int]) -> None:
        """CommandError where a topic that was named tells nothing at any of the frames' stamps."""
        for listener, series in self._topics:
            if stamps and all(series.at(stamp) is None for stamp in stamps):
                raise CommandError(
                    f"{listener.topic} tells nothing within {s_from_ns(_MAX_GAP_NS):.0f} s of any "
                    "frame: are its stamps by another clock?"
                )

    def altitude_at(self, stamp: int) -> AltitudeMeasurement | None:
        """Altitude at a stamp (ns); None where it is not known."""
        if self._altitude_m is not None:
            return AltitudeMeasurement(self._altitude_m, self._altitude_sigma_m)
        known = self._altitudes.at(stamp)
        return None if known is None else AltitudeMeasurement(known[0], self._altitude_sigma_m)

    def reference_at(self, stamp: int) -> NadirReference | None:
        """Nadir at a stamp (ns); None where it is not known."""
        nadir = self._nadirs.at(stamp)
        if nadir is None:
            return None
        return NadirReference(nadir / np.linalg.norm(nadir), self._nadir_sigma_rad)


def read_recording(arguments: argparse.Namespace, stopped: Callable[[], bool]) -> Recording:
    """Read the bag that the command line names; CommandError says why it cannot be used."""
    settings = _settings(arguments)
    pipeline = settings.pipeline
    names = TopicNames(arguments.namespace, arguments.remap)
    horizons = Horizons(pipeline, ns_from_s(arguments.interval), focal=True)
    others = _OtherInstruments(arguments, settings, horizons.sphere, names)
    coarse_pose, imu = _plain(horizons.on_coarse_pose), _plain(horizons.on_imu)
    listeners = [
        Listener(names(COARSE_POSE_TOPIC), POSE_TYPES[:1], coarse_pose, needed=False),
        Listener(names(IMU_TOPIC), (IMU,), imu, needed=False),
        *others.listeners,
    ]
    for camera in pipeline.cameras:
        image = _plain(partial(horizons.on_image, camera))
        camera_info = _plain(partial(horizons.on_camera_info, camera))
        listeners += [
            Listener(names(f"{camera}/image_raw"), (IMAGE,), image),
            Listener(names(f"{camera}/camera_info"), (CAMERA_INFO,), camera_info),
        ]
    for line in listen(arguments.in_bag, listeners, stopped):
        print(line, file=sys.stderr)
    found = sorted(horizons.sets, key=lambda each: each[0])
    others.require([stamp for stamp, _ in found])
    start = found[0][0] if found else 0
    return Recording(
        tuple(
            FrameSet(
                s_from_ns(stamp - start),
                seen,
                others.altitude_at(stamp),
                others.reference_at(stamp),
            )
            for stamp, seen in found
        ),
        {
            camera: rotation_from_quaternion(np.array(quaternion))
            for camera, quaternion in zip(pipeline.cameras, pipeline.rotations, strict=True)
        },
        pipeline.sensor,
        {camera.name: camera.corner_blur_px for camera in pipeline.each},
        horizons.sphere,
        horizons.summary(),
        horizons.hint,
    )


def _settings(arguments: argparse.Namespace) -> HorizonSettings:
    for name in ("altitude_sigma", "reference_sigma"):
        if not 0.0 < getattr(arguments, name) < np.inf:
            option = name.replace("_", "-")
            raise UsageError(f"--{option} must be positive, got {getattr(arguments, name)}")
    try:
        values: list[dict[str, Any]] = (
            [{}]
            if arguments.params is None
            else horizon_values(arguments.params, arguments.namespace)
        )
        settings = settings_of_a_node(values)
    except ParameterError as error:
        hint = "" if arguments.params else "; give the rotations to be corrected with --params FILE"
        raise CommandError(f"{error}{hint}") from None
    cameras = settings.pipeline.cameras
    if None in settings.pipeline.rotations:
        raise CommandError(
            "extrinsics_source is tf; set the rotations to be corrected as parameters"
        )
    if len(cameras) < 2 and arguments.reference is None and not arguments.lenses:
        raise CommandError(
            f"{cameras[0]} is the only camera and has nothing to be compared with; give "
            "--reference TOPIC with the attitude from elsewhere, or --lenses for its lens alone"
        )
    known = arguments.altitude is not None or settings.pipeline.aiding.altitude_sigma_m > 0.0
    if known and not arguments.lenses and settings.pipeline.sensor.planet.flattening > 0.0:
        raise CommandError("limb height is told on a sphere only: no altitude with planet: wgs84")
    return settings


def _number(text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return None


def _plain(take: Callable[[Any], None]) -> Callable[[Any, str], None]:
    return lambda msg, _msgtype: take(msg)


def _into(
    series: Series, topic: str, find: Callable[[Any, str], np.ndarray | float | None]
) -> Callable[[Any, str], None]:
    """Put what is found in a topic's messages into a series, by their stamps."""

    def take(msg: Any, msgtype: str) -> None:
        stamp = stamp_ns(msg)
        try:
            value = find(msg, msgtype)
        except CommandError as error:
            raise CommandError(f"{topic}: {error}") from None
        if value is not None and not isinstance(stamp, Refusal):
            series.add(stamp, value)

    return take
