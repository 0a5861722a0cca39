"""Some of a bag's frame sets, processed once more: what was found in them, by all cameras together
and by each alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.seconds import ns_from_s
from horizon_sensor_ros.ros.messages.message_types import CAMERA_INFO, IMAGE, IMU, POSE
from horizon_sensor_ros.ros.messages.refusal import Refusal
from horizon_sensor_ros.ros.messages.stamps import stamp_ns
from horizon_sensor_ros.ros.parameters.horizon import CAMERA_TIMEOUT, SLOP
from horizon_sensor_ros.ros.parameters.horizon_settings import PipelineSettings
from horizon_sensor_ros.ros.pipelines.aiding_sources import COARSE_POSE_TOPIC, IMU_TOPIC
from horizon_sensor_ros.ros.pipelines.horizon_pipeline import HorizonPipeline, Step
from horizon_sensor_ros.ros.pipelines.pairing import Pairing
from horizon_sensor_ros.tools.bags.bag_listening import Listener
from horizon_sensor_ros.tools.bags.replayed_node import TopicNames
from horizon_sensor_ros.tools.calibration.recording import Horizons
from horizon_sensor_ros.tools.report.blocks import Photo
from horizon_sensor_ros.tools.report.photos import (
    choice_photos,
    fix_photos,
    plain_photo,
    reason_in_words,
)

USUAL_SLOP_NS, _USUAL_TIMEOUT_NS = (
    ns_from_s(float(parameter.default))  # type: ignore[arg-type]
    for parameter in (SLOP, CAMERA_TIMEOUT)
)


@dataclass
class Look:
    """A set of frames looked at again."""

    stamp: int
    answered: bool
    photos: list[Photo] = field(default_factory=list)
    reason: str = ""


class FrameStudy:
    """Chosen sets of frames, processed once more.

    settings : None: nothing is known of how the cameras sit, and frames are only shown. cameras :
    of the bags, for then. shown, compared, refused : stamps of sets whose frames are shown, whose
    cameras are compared, and that had no answer. After the bags were listened to: looks, the sets
    to show; fits, of the compared ones with their stamps; alone, what each camera found in them by
    itself, None without settings.
    """

    def __init__(
        self,
        settings: PipelineSettings | None,
        cameras: tuple[str, ...],
        shown: set[int],
        compared: set[int],
        *,
        refused: set[int],
    ) -> None:
        self._cameras = cameras if settings is None else settings.cameras
        self._settings = settings
        self._shown, self._compared, self._refused = shown, compared, refused
        self._pairing: Pairing[Any] = (
            Pairing(self._cameras, USUAL_SLOP_NS, timeout_ns=_USUAL_TIMEOUT_NS)
            if settings is None
            else Pairing(
                self._cameras, settings.slop_ns, settings.queue_size, settings.camera_timeout_ns
            )
        )
        # Of all cameras; and of those that are left while others are silent.
        self._pipeline = None if settings is None else HorizonPipeline(settings)
        self._of_fewer: dict[tuple[str, ...], HorizonPipeline] = {}
        self.alone = None if settings is None else Horizons(settings, 0, focal=False)
        self.looks: list[Look] = []
        self.fits: list[tuple[int, HorizonFit]] = []

    @property
    def knows_mounting(self) -> bool:
        """Whether it is known how the cameras sit, and frames are not only shown."""
        return self._pipeline is not None

    def listeners(self, names: TopicNames) -> list[Listener]:
        """Return what is to be heard of a bag."""
        found = [
            Listener(names(COARSE_POSE_TOPIC), (POSE,), self._on_coarse_pose, needed=False),
            Listener(names(IMU_TOPIC), (IMU,), self._on_imu, needed=False),
        ]
        for camera in self._cameras:
            image, info = (partial(take, camera) for take in (self._on_image, self._on_camera_info))
            found += [
                Listener(names(f"{camera}/image_raw"), (IMAGE,), image, needed=False),
                Listener(names(f"{camera}/camera_info"), (CAMERA_INFO,), info, needed=False),
            ]
        return found

    def _on_coarse_pose(self, msg: Any, _msgtype: str) -> None:
        if self._pipeline is not None and self.alone is not None:
            for pipeline in (self._pipeline, *self._of_fewer.values()):
                pipeline.aiding.on_coarse_pose(msg)
            self.alone.on_coarse_pose(msg)

    def _on_imu(self, msg: Any, _msgtype: str) -> None:
        if self._pipeline is not None and self.alone is not None:
            for pipeline in (self._pipeline, *self._of_fewer.values()):
                pipeline.aiding.on_imu(msg)
            self.alone.on_imu(msg)

    def _on_camera_info(self, camera: str, msg: Any, _msgtype: str) -> None:
        if self._pipeline is not None and self.alone is not None:
            self._pipeline.on_camera_info(camera, msg)
            for cameras, pipeline in self._of_fewer.items():
                if camera in cameras:
                    pipeline.on_camera_info(camera, msg)
            self.alone.on_camera_info(camera, msg)

    def _on_image(self, camera: str, msg: Any, _msgtype: str) -> None:
        stamp = stamp_ns(msg)
        if isinstance(stamp, Refusal):
            return
        for members in self._pairing.push(camera, stamp, (camera, msg)).sets:
            self._process({stamp for stamp, _ in members}, dict(image for _, image in members))

    def _process(self, stamps: set[int], images: Mapping[str, Any]) -> None:
        """Fit the frames of a chosen set together and, to be compared, each one alone."""
        shown, compared = bool(stamps & self._shown), bool(stamps & self._compared)
        if not (shown or compared):
            return
        look = Look(min(stamps), answered=not stamps & self._refused)
        if shown:
            self.looks.append(look)
        pipeline = self._pipeline_of(tuple(images))
        for name, image in images.items():
            if pipeline is None or self.alone is None:
                look.photos += plain_photo(name, image) if shown else []
                continue
            if compared:
                self.alone.on_image(name, image)
            step = pipeline.on_image(name, image)
            if compared:
                self.fits += [(r.stamp, r.fix.fit) for r in step.results if r.fix.ok]
            if shown:
                _take_note(look, name, image, step)

    def _pipeline_of(self, cameras: tuple[str, ...]) -> HorizonPipeline | None:
        """That of a set's cameras; only some of the sets are processed, so it waits for no other.

        None where nothing is known of how the cameras sit.
        """
        if self._pipeline is None or self._settings is None or cameras == self._cameras:
            return self._pipeline
        if cameras not in self._of_fewer:
            each = tuple(told for told in self._settings.each if told.name in cameras)
            fewer = replace(self._settings, each=each)
            self._of_fewer[cameras] = self._pipeline.with_settings(fewer)
        return self._of_fewer[cameras]


def _take_note(look: Look, camera: str, image: Any, step: Step) -> None:
    """Add to a set's pictures and reasons what came of one of its images."""
    if step.refusal is not None:
        look.reason += f"{camera}: {step.refusal.reason}. "
        look.photos += plain_photo(camera, image)
    for result in step.results:
        look.reason += reason_in_words(result.frames, result.fix)
        photos = fix_photos if look.answered else choice_photos
        look.photos += photos(result.frames, result.fix)
