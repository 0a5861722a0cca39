"""From image and camera_info messages to horizon fixes: what the live nodes and the replay share.

No node, no clock and no topic in here, so that the same messages in the same order give the same
results, live or offline.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.cameras.linear_light import linear_light
from horizon_sensor_ros.core.cameras.mask import Mask
from horizon_sensor_ros.core.cameras.white_level import full_scale
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.mathematics.attitude import rotation_from_quaternion
from horizon_sensor_ros.core.seconds import nearest_s_from_ns
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.ros.files.resources import read_mask
from horizon_sensor_ros.ros.messages.camera_info import camera_from_info, camera_info_key
from horizon_sensor_ros.ros.messages.images import gray_from_image
from horizon_sensor_ros.ros.messages.refusal import Refusal, internal_error
from horizon_sensor_ros.ros.messages.stamps import repeated_stamp, stamp_ns
from horizon_sensor_ros.ros.parameters.horizon_settings import CameraSettings, PipelineSettings
from horizon_sensor_ros.ros.pipelines.aiding_sources import AidingSources
from horizon_sensor_ros.ros.pipelines.pairing import Pairing

# Rotation (3, 3), optical to base frame, of a camera: its name and its images' frame_id.
Extrinsics = Callable[[str, str], "np.ndarray | Refusal"]
# Up to here, rad, a rotation that TF composes anew for each frame is the last one: another would be
# another camera, whose limb is searched for.
_SAME_ROTATION = 1e-9


@dataclass(frozen=True)
class HorizonResult:
    """A set of frames and what came of it.

    stamp : nanoseconds, that of the first listed camera used in the fix; without a fix that of the
    first camera. frames : as processed, in the cameras' order, without those that are silent.
    """

    stamp: int
    fix: HorizonFix
    frames: tuple[Frame, ...]


@dataclass(frozen=True)
class Step:
    """What became of one image: the results it completed, or why it was not used.

    apart_ns : of an image that completed nothing, how far its stamp is from the nearest of the
    other cameras' last ones, if there are any.
    """

    camera: str
    results: tuple[HorizonResult, ...] = ()
    refusal: Refusal | None = None
    apart_ns: int | None = None


@dataclass
class _CameraState:
    """What is told of a camera, its latest calibration, and the view made from both; the highest
    white level that its frames have shown.
    """

    told: CameraSettings
    mask: Mask | None
    info_key: tuple[Any, ...] | None = None
    camera: Camera | Refusal | None = None
    view: CameraView | None = None
    white: int = 0

    @classmethod
    def of(cls, told: CameraSettings) -> _CameraState:
        """Of a camera without a calibration."""
        return cls(told, None if told.mask is None else read_mask(told.mask))

    def light(self, gray: np.ndarray) -> np.ndarray:
        """Pixels in proportion to light of a frame (H, W)."""
        if self.told.gamma != 1.0:
            # From frame to frame the scale must not change with the brightest pixel; after frames
            # of 16 bits it says nothing of those of eight.
            known = self.white if self.white <= np.iinfo(gray.dtype).max else 0
            self.white = max(known, full_scale(gray))
        return linear_light(gray, self.told.gamma, self.white)


class HorizonPipeline:
    """Decodes, pairs and processes the frames of the cameras of `settings`.

    counts : sets, fixes, time jumps. rejected : frames that gave no estimate, and sets without a
    fix, by cause. aiding : the topics coarse_pose and imu.
    """

    def __init__(self, settings: PipelineSettings, extrinsics: Extrinsics | None = None) -> None:
        self.settings = settings
        self.counts: Counter[str] = Counter()
        self.rejected: Counter[str] = Counter()
        self._extrinsics = extrinsics or _fixed_extrinsics(settings)
        self._sensor = HorizonSensor(settings.sensor)
        self._pairing: Pairing[Frame] = self._new_pairing()
        self._cameras = {told.name: _CameraState.of(told) for told in settings.each}
        self.aiding = AidingSources(settings.aiding, settings.sensor.planet, settings.base_frame)

    def with_settings(self, settings: PipelineSettings) -> HorizonPipeline:
        """Return a pipeline of the same cameras with other settings; calibrations and counts go
        along.
        """
        other = HorizonPipeline(settings, self._extrinsics)
        other.counts, other.rejected = self.counts.copy(), self.rejected.copy()
        other._pairing.go_on_from(self._pairing)
        # Copies: this pipeline may go on beside the other one, with the same messages.
        for name, state in other._cameras.items():
            known = self._cameras[name]
            state.info_key, state.camera = known.info_key, known.camera
            state.white = known.white
        other.aiding = self.aiding.with_settings(
            settings.aiding, settings.sensor.planet, settings.base_frame
        )
        return other

    def reset(self) -> None:
        """Forget all frames, but for their stamps, and any track; calibrations and counts stay."""
        self._sensor.reset()
        self.aiding.reset()
        before, self._pairing = self._pairing, self._new_pairing()
        self._pairing.go_on_from(before)

    def on_camera_info(self, camera: str, msg: Any) -> None:
        """Take a camera's calibration; it counts from the next image on.

        Never raises for what is in a message.
        """
        state = self._cameras[camera]
        try:
            key = camera_info_key(msg)
        except (TypeError, ValueError) as error:
            state.info_key = None
            state.camera = Refusal("bad_camera_info", f"camera_info cannot be read: {error}")
            return
        if key == state.info_key:
            return
        state.info_key = key
        try:
            state.camera = camera_from_info(msg)
        except Exception as error:
            # As in `on_image`: a defect of ours costs a calibration, not the node.
            state.camera = internal_error(error)

    def on_image(self, camera: str, msg: Any) -> Step:
        """Take an image; say what came of it. Never raises for what is in a message."""
        self.counts["frames"] += 1
        try:
            return self._take_image(camera, msg)
        except Exception as error:
            # The last defence of a flight process: a defect of ours costs a frame, not the node.
            return self._refuse(camera, internal_error(error))

    def _take_image(self, camera: str, msg: Any) -> Step:
        stamp = stamp_ns(msg)
        if isinstance(stamp, Refusal):
            return self._refuse(camera, stamp)
        frame = self._frame(camera, msg)
        if isinstance(frame, Refusal):
            return self._refuse(camera, frame)
        paired = self._pairing.push(camera, stamp, frame)
        if paired.unpaired:
            self.rejected["unpaired"] += paired.unpaired
        if paired.repeated:
            return self._refuse(camera, repeated_stamp(stamp))
        if paired.jumped:
            self.counts["time_jumps"] += paired.first_to_jump
            self._sensor.reset()
            self.aiding.jump_back(stamp)
        results = tuple(self._process(members) for members in paired.sets)
        apart_ns = None if results else self._pairing.nearest_ns(camera)
        return Step(camera, results, apart_ns=apart_ns)

    def warm_up(self) -> tuple[HorizonFix, ...]:
        """Run the whole way once, so that the first real frame is not slow: a limb of clouds below
        air that glows, drawn here, is searched for and followed. Returns the fixes.
        """
        # Thresholds as they come: at one that is not passed the way would end early.
        own = self.settings.sensor
        sensor = HorizonSensor(HorizonConfig(method=own.method, limb=own.limb))
        camera = Camera(320, 240, 277.0, 277.0, 159.5, 119.5)
        view = CameraView("warm_up", camera, np.eye(3))
        shape, rng = (camera.height, camera.width), np.random.default_rng(0)
        pixels = np.argwhere(np.ones(shape))[:, ::-1].astype(float)
        rho_rad = 1.14  # from some 600 km
        nadir = np.array([0.0, np.sin(rho_rad), np.cos(rho_rad)])
        beyond_px = camera.fx * (np.arccos(camera.rays(pixels) @ nadir) - rho_rad).reshape(shape)
        clouds = 130.0 + 200.0 * cv2.GaussianBlur(rng.normal(size=shape), (0, 0), 3.0)
        sky = 90.0 * np.exp(-np.maximum(beyond_px, 0.0) / 1.6)
        light = cv2.GaussianBlur(np.where(beyond_px < 0.0, clouds, sky), (0, 0), 0.8)
        fixes = []
        for dtype, gain in ((np.uint8, 1.0), (np.uint8, 1.0), (np.uint16, 256.0)):
            levels = gain * (light + rng.normal(6.0, 2.0, shape))
            fixes.append(sensor.process([Frame(view, levels.astype(dtype))]))
        return tuple(fixes)

    def _new_pairing(self) -> Pairing[Frame]:
        s = self.settings
        return Pairing(s.cameras, s.slop_ns, s.queue_size, s.camera_timeout_ns)

    def _refuse(self, camera: str, refusal: Refusal) -> Step:
        self.rejected[refusal.cause] += 1
        return Step(camera, refusal=refusal)

    def _frame(self, name: str, msg: Any) -> Frame | Refusal:
        gray = gray_from_image(msg)
        if isinstance(gray, Refusal):
            return gray
        state = self._cameras[name]
        camera = state.camera
        if camera is None:
            return Refusal("no_camera_info", f"no camera_info yet for {name}")
        if isinstance(camera, Refusal):
            return camera
        height, width = gray.shape
        if (camera.width, camera.height) != (width, height):
            return Refusal(
                "size_mismatch",
                f"image is {width} x {height}, camera_info says {camera.width} x {camera.height}",
            )
        if state.mask is not None and state.mask.shape != (height, width):
            rows, columns = state.mask.shape
            return Refusal("mask_size", f"image is {width} x {height}, the mask {columns} x {rows}")
        rot_base_from_cam = self._extrinsics(name, str(msg.header.frame_id))
        if isinstance(rot_base_from_cam, Refusal):
            return rot_base_from_cam
        view = state.view
        if (
            view is None
            or view.camera is not camera
            or not np.abs(view.rot_base_from_cam - rot_base_from_cam).max() <= _SAME_ROTATION
        ):
            view = state.view = CameraView(
                name,
                camera,
                rot_base_from_cam,
                state.mask,
                state.told.readout_s,
                state.told.exposure_s,
                corner_blur_px=state.told.corner_blur_px,
            )
        return Frame(view, state.light(gray))

    def _process(self, members: tuple[tuple[int, Frame], ...]) -> HorizonResult:
        self.counts["sets"] += 1
        first = members[0][0]
        frames = tuple(
            frame if stamp == first else replace(frame, after_s=nearest_s_from_ns(stamp - first))
            for stamp, frame in members
        )
        fix = self._sensor.process(frames, self.aiding.of_set(first))
        if fix.status is Status.OK and not _finite(fix.fit):
            fix = HorizonFix(Status.UNCERTAIN, "the estimate is not finite", fix.fit, fix.limbs, ())
        if fix.status is Status.OK:
            self.counts["fixes"] += 1
        else:
            self.rejected[str(fix.status)] += 1
        if fix.views:
            seen = zip(frames, fix.views, strict=True)
            frames = tuple(replace(frame, view=view) for frame, view in seen)
        stamps = [stamp for stamp, frame in members if frame.view.name in fix.cameras_used]
        return HorizonResult(stamps[0] if stamps else first, fix, frames)


def _finite(fit: HorizonFit) -> bool:
    parts = (fit.nadir_base, fit.altitude_m, fit.cov_nadir_altitude)
    return all(np.all(np.isfinite(part)) for part in parts)


def _fixed_extrinsics(settings: PipelineSettings) -> Extrinsics:
    rotations = {
        name: rotation_from_quaternion(np.array(quaternion))
        for name, quaternion in zip(settings.cameras, settings.rotations, strict=True)
        if quaternion is not None
    }
    missing = [name for name in settings.cameras if name not in rotations]
    if missing:
        raise ValueError(f"no rotation for {', '.join(missing)}")
    return lambda name, _frame_id: rotations[name]
