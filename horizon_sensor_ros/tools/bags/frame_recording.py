"""Frames of folders into a bag: what `horizon_bag_from_images` does."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from tqdm import tqdm

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.mathematics.attitude import quaternion_from_rotation
from horizon_sensor_ros.core.seconds import ns_from_s
from horizon_sensor_ros.ros.messages.sensors import (
    camera_info_message,
    cloud_message,
    encoded_image,
)
from horizon_sensor_ros.ros.parameters.horizon_settings import cameras_of
from horizon_sensor_ros.ros.parameters.parameter import ParameterError
from horizon_sensor_ros.ros.pipelines.target_pipeline import CLOUD_TOPIC
from horizon_sensor_ros.tools.bags.cloud_files import CLOUD_SUFFIXES, read_cloud
from horizon_sensor_ros.tools.bags.frame_files import FrameFile, StampRule, frame_files
from horizon_sensor_ros.tools.bags.input_bag import STORAGE
from horizon_sensor_ros.tools.bags.output_bag import OutputBag, check_replaceable
from horizon_sensor_ros.tools.camera_file import CameraFileError, Rig, read_camera_file
from horizon_sensor_ros.tools.command_errors import CommandError
from horizon_sensor_ros.tools.output_files import written_whole

IMAGE_SUFFIXES = (
    ".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp",
)  # fmt: skip
_MOST_IMAGE_BYTES = 500_000_000


@dataclass(frozen=True)
class _Source:
    """Frames of one sensor, and how one of them becomes messages with their topics."""

    name: str
    frames: list[FrameFile]
    topics: dict[str, type]
    messages: Callable[[FrameFile], list[tuple[str, Any]]]


def record(arguments: argparse.Namespace, stopped: Callable[[], bool] = bool) -> str:
    """Do what the command line asks for and return what was done.

    Raises CommandError, saying why there is no bag, and KeyboardInterrupt soon after `stopped` says
    so; nothing is then left behind.
    """
    out: Path = arguments.out_bag
    check_replaceable(out, *_inputs(arguments), force=arguments.force)
    params = out.with_name(out.name + ".params.yaml")
    if arguments.images and params.exists() and not arguments.force:
        raise CommandError(f"{params} exists; choose another OUT_BAG, or --force to replace it")
    rig = _read_rig(arguments.camera_file) if arguments.images else None
    sources = _sources(arguments, rig)
    bag = OutputBag(out, STORAGE[arguments.storage])
    try:
        _write(bag, sources, stopped)
        if rig is None:
            bag.finish()
        else:
            # An older file stays what it is until the bag that the new one belongs to is there.
            with written_whole(params) as (fresh,):
                used = [source.name for source in sources if source.name != CLOUD_TOPIC]
                text = _parameter_file(rig, used, arguments.camera_file)
                fresh.write_text(text, encoding="utf-8")
                bag.finish()
    except BaseException:
        bag.discard()
        raise
    said = ", ".join(f"{len(source.frames)} frames of {source.name}" for source in sources)
    if rig is None:
        return f"wrote {out}: {said}\nnext: horizon_replay {out} {out}_out"
    return (
        f"wrote {out}: {said}; and {params}\nnext: horizon_replay {out} {out}_out --params {params}"
    )


def _read_rig(file: Path) -> Rig:
    try:
        return read_camera_file(file)
    except CameraFileError as error:
        raise CommandError(str(error)) from None


def _sources(arguments: argparse.Namespace, rig: Rig | None) -> list[_Source]:
    rule = StampRule(
        arguments.stamps,
        arguments.stamps_in_names,
        arguments.stamp_unit,
        arguments.rate,
        ns_from_s(arguments.start),
    )
    sources = []
    if rig is not None:
        folders = _folders(arguments.images, rig, arguments.camera_file)
        sources = [_camera_source(view, folder, rule) for view, folder in folders]
    if rule.file is None and not rule.in_names and len({len(s.frames) for s in sources}) > 1:
        counts = ", ".join(f"{source.name}: {len(source.frames)}" for source in sources)
        raise CommandError(
            f"the cameras have not the same number of images ({counts}), so that by --rate alone "
            "the wrong ones would meet; give --stamps or --stamps-in-names, or remove the odd ones"
        )
    if arguments.clouds:
        sources.append(_cloud_source(arguments.clouds, arguments.cloud_frame, rule))
    return sources


def _inputs(arguments: argparse.Namespace) -> list[Path]:
    folders = [Path(text.rpartition("=")[2]) for text in arguments.images]
    return [*folders, *([arguments.clouds] if arguments.clouds else [])]


def _is_same(one: Path, other: Path) -> bool:
    return one.exists() and other.exists() and one.samefile(other)


def _folders(given: list[str], rig: Rig, file: Path) -> list[tuple[CameraView, Path]]:
    """Cameras of the file with their folders."""
    views = {view.name: view for view in rig.views}
    found: dict[str, Path] = {}
    for text in given:
        name, equals, folder = text.rpartition("=")
        if not equals and len(views) == 1:
            (name,) = views
        if name not in views:
            what = f"no camera {name!r}" if equals else f"more than one camera for {text!r}"
            raise CommandError(
                f"--images {text}: {file} has {what}; write CAMERA=FOLDER, with one of "
                f"{', '.join(views)}"
            )
        if name in found:
            raise CommandError(f"--images {text}: {name} has its folder already, {found[name]}")
        twin = next((other for other, path in found.items() if _is_same(path, Path(folder))), None)
        if twin is not None:
            raise CommandError(f"--images {text}: that is the folder of {twin} already")
        found[name] = Path(folder)
    try:
        cameras_of({"cameras": list(found)})
    except ParameterError as error:
        raise CommandError(f"{file}: {error}") from None
    return [(views[name], folder) for name, folder in found.items()]


def _camera_source(view: CameraView, folder: Path, rule: StampRule) -> _Source:
    image_topic, info_topic = f"/{view.name}/image_raw", f"/{view.name}/camera_info"
    frame_id = f"{view.name}_optical"

    def messages(frame: FrameFile) -> list[tuple[str, Any]]:
        pixels = read_image(frame.path, view)
        return [
            (info_topic, camera_info_message(view.camera, frame.stamp, frame_id)),
            (image_topic, encoded_image(pixels, frame.stamp, frame_id)),
        ]

    frames = frame_files(folder, IMAGE_SUFFIXES, rule)
    return _Source(view.name, frames, {info_topic: CameraInfo, image_topic: Image}, messages)


def _cloud_source(folder: Path, frame_id: str, rule: StampRule) -> _Source:
    topic = f"/{CLOUD_TOPIC}"

    def messages(frame: FrameFile) -> list[tuple[str, Any]]:
        return [(topic, cloud_message(read_cloud(frame.path), frame.stamp, frame_id))]

    return _Source(
        CLOUD_TOPIC, frame_files(folder, CLOUD_SUFFIXES, rule), {topic: PointCloud2}, messages
    )


def read_image(path: Path, view: CameraView) -> np.ndarray:
    """Pixels of a file as `encoded_image` takes them; colours of 16 bits come back as gray.

    Raises CommandError where it is no image, or not one of this camera.
    """
    try:
        size = path.stat().st_size
        if size > _MOST_IMAGE_BYTES:
            raise CommandError(
                f"{path}: has {size} bytes, more than the {_MOST_IMAGE_BYTES} allowed"
            )
        data = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError as error:
        raise CommandError(f"{path}: cannot be read: {error.strerror}") from None
    # Unchanged also means not turned by what EXIF says: the calibration is that of the raw frame.
    try:
        pixels = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    except cv2.error:
        # A header that promises more than OpenCV takes.
        pixels = None
    if pixels is None:
        raise CommandError(f"{path}: is no image that OpenCV can read; remove it, or convert it")
    height, width = pixels.shape[:2]
    camera = view.camera
    if (width, height) != (camera.width, camera.height):
        raise CommandError(
            f"{path}: has {width} x {height} pixels, the camera file says {camera.width} x "
            f"{camera.height} for {view.name}; correct the one or the other"
        )
    if pixels.dtype not in (np.uint8, np.uint16):
        raise CommandError(f"{path}: has pixels of {pixels.dtype}; convert it to 8 or 16 bits")
    if pixels.ndim == 3 and pixels.dtype == np.uint16:
        return cv2.cvtColor(pixels[..., :3], cv2.COLOR_BGR2GRAY)
    return pixels


def _write(bag: OutputBag, sources: list[_Source], stopped: Callable[[], bool]) -> None:
    for source in sources:
        for topic, kind in source.topics.items():
            bag.add_topic(topic, kind)
    frames = sorted(
        ((frame, source) for source in sources for frame in source.frames),
        key=lambda pair: pair[0].stamp,
    )
    for frame, source in tqdm(frames, unit="frame", file=sys.stderr):
        if stopped():
            raise KeyboardInterrupt
        # A nanosecond apart, so that the calibration comes before its image in every reader.
        for delay, (topic, message) in enumerate(source.messages(frame)):
            bag.write(topic, frame.stamp + delay, message)


def _parameter_file(rig: Rig, names: list[str], file: Path) -> str:
    return "\n".join(_parameter_lines(rig, names, file)) + "\n"


def _parameter_lines(rig: Rig, names: list[str], file: Path) -> Iterator[str]:
    planet = rig.planet
    yield f"# Cameras and planet of {file.name}, for the nodes and horizon_replay --params."
    yield from ("/**:", "  ros__parameters:", f"    cameras: [{', '.join(names)}]")
    # Towards the planet at zero roll and pitch: that is what level_z says.
    yield f"    level_z: {'down' if rig.nadir_at_zero[2] > 0 else 'up'}"
    yield f"    planet: {'sphere' if planet.flattening == 0 else 'wgs84'}"
    if planet.flattening == 0:
        yield f"    planet_radius: {planet.radius_m!r}"
    yield f"    limb_height: {planet.limb_height_m!r}"
    for view in rig.views:
        if view.name in names:
            q = quaternion_from_rotation(view.rot_base_from_cam)
            yield from (f"    {view.name}:", f"      rotation: {[float(v) for v in q]}")
