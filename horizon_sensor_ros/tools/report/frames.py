"""The report's second look at the frames: what was found in some, why others were refused, and
whether the cameras agree.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.mathematics.attitude import rotation_from_quaternion
from horizon_sensor_ros.core.self_calibration.differences import (
    NadirDifference,
    nadir_differences,
)
from horizon_sensor_ros.core.self_calibration.measurement import FrameSet
from horizon_sensor_ros.ros.aiding_sources import COARSE_POSE_TOPIC, IMU_TOPIC
from horizon_sensor_ros.ros.horizon_pipeline import HorizonPipeline, Step
from horizon_sensor_ros.ros.messages import NANOSECONDS, Refusal, stamp_ns
from horizon_sensor_ros.ros.pairing import Pairing
from horizon_sensor_ros.ros.parameters.horizon import CAMERA_TIMEOUT, SLOP
from horizon_sensor_ros.ros.parameters.horizon_settings import (
    HorizonSettings,
    PipelineSettings,
)
from horizon_sensor_ros.ros.parameters.parameter import ParameterError
from horizon_sensor_ros.tools.bag_errors import BagError
from horizon_sensor_ros.tools.bags.bag_listening import Listener, listen
from horizon_sensor_ros.tools.bags.message_types import (
    CAMERA_INFO,
    IMAGE,
    IMU,
    POSE,
)
from horizon_sensor_ros.tools.bags.replayed_node import TopicNames
from horizon_sensor_ros.tools.calibration.recording import Horizons
from horizon_sensor_ros.tools.horizon_parameters import horizon_values, settings_of_a_node
from horizon_sensor_ros.tools.report.bags import Recorded
from horizon_sensor_ros.tools.report.blocks import (
    COLOURS,
    Block,
    Photo,
    Photos,
    Section,
    Table,
    Text,
    chart,
    from_zero,
    legend,
)
from horizon_sensor_ros.tools.report.photos import (
    choice_photos,
    fix_photos,
    plain_photo,
    reason_in_words,
)

_REFUSED_SHOWN, _ANSWERED_SHOWN, _COMPARED = 8, 4, 60
_USUAL_SLOP_NS, _USUAL_TIMEOUT_NS = (
    round(float(parameter.default) * NANOSECONDS)  # type: ignore[arg-type]
    for parameter in (SLOP, CAMERA_TIMEOUT)
)


@dataclass
class _Look:
    """A set of frames looked at again."""

    stamp: int
    answered: bool
    photos: list[Photo] = field(default_factory=list)
    reason: str = ""


@dataclass(frozen=True)
class SecondLook:
    """refused : blocks on the refused frames. answered : frames and what was found in them, None
    without any. residuals : of the fits. agreement : of the cameras, None where less than two saw
    the limb.
    """

    refused: tuple[Block, ...]
    answered: Section | None = None
    residuals: tuple[Block, ...] = ()
    agreement: Section | None = None


def parameter_values(params: Path | None, namespace: str) -> list[dict[str, Any]] | None:
    """What a parameter file has for each of the horizon's nodes; None without one. BagError says
    what is wrong with it.
    """
    if params is None:
        return None
    try:
        return horizon_values(params, namespace)
    except ParameterError as error:
        raise BagError(str(error)) from None


def pipeline_settings(values: Sequence[Mapping[str, Any]] | None) -> HorizonSettings | None:
    """Settings of such values; None without any. BagError says what is wrong with them."""
    if values is None:
        return None
    try:
        return settings_of_a_node(values)
    except ParameterError as error:
        raise BagError(str(error)) from None


def _without_frames(recorded: Recorded) -> list[Block]:
    """What is to be said where the bags have no frames: nothing, of a target alone."""
    if not recorded.of_horizon:
        return []
    if len(recorded.bags) == 1:
        return [Text("The frames are not in the bag: give the one that has them with --input.")]
    bags = " nor in ".join(path.name for path in recorded.bags)
    return [
        Text(
            f"The frames are neither in {bags}: give the bag that has them with --input, and "
            "--remap FROM:=TO where their topics have other names than the nodes'."
        )
    ]


def look_again(
    recorded: Recorded,
    settings: HorizonSettings | None,
    names: TopicNames,
    stopped: Callable[[], bool],
) -> SecondLook:
    """Look at some of the frames again.

    settings : of the nodes; None: nothing is known of how the cameras sit, so frames are shown as
    they are.
    """
    if not recorded.frames:
        return SecondLook(tuple(_without_frames(recorded)))
    notes: list[Block] = []
    if settings is None:
        notes.append(Text("How the limb was chosen is shown when --params FILE is given."))
    else:
        notes += _silent_cameras(recorded, settings)
        if None in settings.pipeline.rotations:
            settings = None
            notes.append(
                Text(
                    "How the limb was chosen is not shown: extrinsics_source is tf, and a report "
                    "has no TF. Give --params FILE with the rotations as parameters."
                )
            )
    answered, refused = _split(recorded, settings)
    shown = _spread_over(refused, _REFUSED_SHOWN)
    study = _Study(
        settings.pipeline if settings is not None else None,
        tuple(recorded.frames),
        {*shown, *_spread_over(answered, _ANSWERED_SHOWN)},
        set(_spread_over(answered + refused, _COMPARED)),
        refused=set(refused),
    )
    for bag in recorded.bags:
        listen(bag, study.listeners(names), stopped)
    blocks: list[Block] = [
        Text(f"{len(refused)} of {len(refused) + len(answered)} frame sets have no answer.")
    ]
    blocks += notes
    start_ns = recorded.start_ns
    blocks += study.refused_photographs(start_ns)
    return SecondLook(
        tuple(blocks),
        study.answered_photographs(start_ns),
        study.residuals(start_ns),
        study.agreement(start_ns),
    )


def _silent_cameras(recorded: Recorded, settings: HorizonSettings) -> list[Block]:
    """Say which cameras are to be used and have no frames."""
    missing = [name for name in settings.pipeline.cameras if name not in recorded.frames]
    if not missing:
        return []
    timeout_s = settings.pipeline.camera_timeout_ns / NANOSECONDS
    how_long = f"{timeout_s:g} s" if timeout_s > 0.0 else "for ever"
    return [
        Text(
            f"The bags have no frames of {', '.join(missing)}, which the parameters name: no "
            f"answer while the others' frames wait for them (camera_timeout: {how_long})."
        )
    ]


def _split(recorded: Recorded, settings: HorizonSettings | None) -> tuple[list[int], list[int]]:
    """Stamps of the sets with an answer and of those without, by the camera with most frames."""
    topics = ("attitude", "local_vertical")
    answers = np.array(sorted({s for t in topics for s in recorded.answers.get(t, {})}), dtype=int)
    slop = settings.pipeline.slop_ns if settings is not None else _USUAL_SLOP_NS
    answered: list[int] = []
    refused: list[int] = []
    for stamp in recorded.camera_sets():
        # An answer has the stamp of a camera that was used, which may be another one.
        at = np.searchsorted(answers, stamp - slop)
        has = at < len(answers) and answers[at] <= stamp + slop
        (answered if has else refused).append(stamp)
    return answered, refused


def _spread_over(stamps: Sequence[int], most: int) -> list[int]:
    """Evenly chosen ones."""
    ordered = sorted(stamps)
    if len(ordered) <= most:
        return ordered
    return [ordered[round(i)] for i in np.linspace(0, len(ordered) - 1, most)]


class _Study:
    """Chosen sets of frames, processed once more."""

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
            Pairing(self._cameras, _USUAL_SLOP_NS, timeout_ns=_USUAL_TIMEOUT_NS)
            if settings is None
            else Pairing(
                self._cameras, settings.slop_ns, settings.queue_size, settings.camera_timeout_ns
            )
        )
        # Of all cameras; and of those that are left while others are silent.
        self._pipeline = None if settings is None else HorizonPipeline(settings)
        self._of_fewer: dict[tuple[str, ...], HorizonPipeline] = {}
        self._alone = None if settings is None else Horizons(settings, 0, focal=False)
        self._looks: list[_Look] = []
        self._fits: list[tuple[int, HorizonFit]] = []

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
        if self._pipeline is not None and self._alone is not None:
            for pipeline in (self._pipeline, *self._of_fewer.values()):
                pipeline.aiding.on_coarse_pose(msg)
            self._alone.on_coarse_pose(msg)

    def _on_imu(self, msg: Any, _msgtype: str) -> None:
        if self._pipeline is not None and self._alone is not None:
            for pipeline in (self._pipeline, *self._of_fewer.values()):
                pipeline.aiding.on_imu(msg)
            self._alone.on_imu(msg)

    def _on_camera_info(self, camera: str, msg: Any, _msgtype: str) -> None:
        if self._pipeline is not None and self._alone is not None:
            self._pipeline.on_camera_info(camera, msg)
            for cameras, pipeline in self._of_fewer.items():
                if camera in cameras:
                    pipeline.on_camera_info(camera, msg)
            self._alone.on_camera_info(camera, msg)

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
        look = _Look(min(stamps), answered=not stamps & self._refused)
        if shown:
            self._looks.append(look)
        pipeline = self._pipeline_of(tuple(images))
        for name, image in images.items():
            if pipeline is None or self._alone is None:
                look.photos += plain_photo(name, image) if shown else []
                continue
            if compared:
                self._alone.on_image(name, image)
            step = pipeline.on_image(name, image)
            if compared:
                self._fits += [(r.stamp, r.fix.fit) for r in step.results if r.fix.ok]
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

    def refused_photographs(self, start_ns: int) -> list[Block]:
        """Return the frames without an answer."""
        blocks: list[Block] = []
        if self._pipeline is not None and any(not look.answered for look in self._looks):
            blocks.append(
                Text(
                    "Blue dots: points chosen as the limb. Red crosses: edges that border on "
                    "darkness and were thrown away."
                )
            )
        return blocks + self._photographs(start_ns, answered=False)

    def answered_photographs(self, start_ns: int) -> Section | None:
        """Return frames with an answer, and what was found in them; None without any."""
        blocks: list[Block] = []
        if self._pipeline is not None:
            blocks.append(
                Text(
                    "Some frames, processed once more, drawn as on ~/debug_image. Yellow dots: "
                    "limb points; red crosses: points that the fit threw away. Blue: the fitted "
                    "limb, dashed where it is only predicted. White: the way to nadir; in the "
                    "corner its one-sigma ellipse."
                )
            )
        photographs = self._photographs(start_ns, answered=True)
        if not photographs:
            return None
        return Section("frames", "What the cameras saw", (*blocks, *photographs))

    def _photographs(self, start_ns: int, *, answered: bool) -> list[Block]:
        blocks: list[Block] = []
        for look in sorted(self._looks, key=lambda each: each.stamp):
            if look.photos and look.answered == answered:
                when = f"{(look.stamp - start_ns) * 1e-9:.2f} s"
                word = "answered" if answered else "no answer"
                why = f": {look.reason.strip()}" if look.reason.strip() else ""
                blocks.append(Photos(tuple(look.photos), f"{when}, {word}{why}"))
        return blocks

    def residuals(self, start_ns: int) -> tuple[Block, ...]:
        """Return residuals and points of the fits; nothing without any."""
        if not self._fits:
            return ()
        times = np.array([stamp - start_ns for stamp, _ in self._fits]) * 1e-9
        fits = [fit for _, fit in self._fits]
        return (
            chart(
                "Residuals and numbers of points of the horizon's fits over time.",
                f"{len(fits)} frame sets, evenly chosen and processed once more: root mean square "
                "distance of the limb's points from the fit, and how many points that were.",
                lambda axes: _draw_fits(axes, times, fits),
                panels=2,
            ),
        )

    def agreement(self, start_ns: int) -> Section | None:
        """Return how far the cameras' nadirs lie apart; None with less than two that saw it."""
        if self._alone is None or self._settings is None:
            return None
        rotations = {
            name: rotation_from_quaternion(np.array(quaternion))
            for name, quaternion in zip(
                self._settings.cameras, self._settings.rotations, strict=True
            )
        }
        sets = [FrameSet((s - start_ns) * 1e-9, seen) for s, seen in self._alone.sets if seen]
        differences = nadir_differences(sets, rotations)
        if not differences:
            return None
        times = np.array([each.time_s for each in sets])
        rows = tuple(_row(difference) for difference in differences)
        blocks: tuple[Block, ...] = (
            Table(("nadirs", "frame sets", "median (deg)", "RMS (deg)", "largest (deg)"), rows),
            chart(
                "Angle between the cameras' nadirs over time.",
                "Each camera's nadir found in its own frame alone. A constant part is how they "
                "are mounted: horizon_self_calibration tells.",
                lambda axes: _draw_agreement(axes[0], times, differences),
                panel_height=2.0,
            ),
        )
        return Section("agreement", "Agreement of the cameras", blocks)


def _draw_fits(axes: Sequence[Axes], times_s: np.ndarray, fits: Sequence[HorizonFit]) -> None:
    axes[0].plot(times_s, [fit.rms_residual_px for fit in fits], ".", color=COLOURS[0])
    axes[0].set(ylabel="residual (px)")
    axes[1].plot(times_s, [fit.num_inliers for fit in fits], ".", color="0.3")
    axes[1].set(ylabel="points", xlabel="time (s)")
    for panel in axes:
        from_zero(panel)


def _row(difference: NadirDifference) -> tuple[str, ...]:
    angle = np.degrees(np.linalg.norm(difference.turn_rad, axis=1))
    figures = (np.median(angle), np.degrees(difference.rms_rad), angle.max())
    return (difference.name, str(len(angle)), *(f"{value:.4f}" for value in figures))


def _draw_agreement(
    axes: Axes, times_s: np.ndarray, differences: Sequence[NadirDifference]
) -> None:
    for difference, colour, marker in zip(differences, COLOURS, "ox+^v", strict=False):
        angle = np.degrees(np.linalg.norm(difference.turn_rad, axis=1))
        axes.plot(
            times_s[difference.index], angle, marker, color=colour, markersize=4,
            label=difference.name,
        )  # fmt: skip
    axes.set(xlabel="time (s)", ylabel="angle (deg)")
    from_zero(axes)
    legend(axes)


def _take_note(look: _Look, camera: str, image: Any, step: Step) -> None:
    """Add to a set's pictures and reasons what came of one of its images."""
    if step.refusal is not None:
        look.reason += f"{camera}: {step.refusal.reason}. "
        look.photos += plain_photo(camera, image)
    for result in step.results:
        look.reason += reason_in_words(result.frames, result.fix)
        photos = fix_photos if look.answered else choice_photos
        look.photos += photos(result.frames, result.fix)
