"""The report's second look at the frames: what was found in some, and why others were refused."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.seconds import nearest_s_from_ns, s_from_ns
from horizon_sensor_ros.ros.parameters.horizon_settings import HorizonSettings
from horizon_sensor_ros.tools.bags.bag_listening import listen
from horizon_sensor_ros.tools.bags.replayed_node import TopicNames
from horizon_sensor_ros.tools.report.agreement import agreement_section
from horizon_sensor_ros.tools.report.blocks import Block, Photos, Section, Text
from horizon_sensor_ros.tools.report.frame_study import USUAL_SLOP_NS, FrameStudy
from horizon_sensor_ros.tools.report.recorded import Recorded
from horizon_sensor_ros.tools.report.residuals import fit_blocks

_REFUSED_SHOWN, _ANSWERED_SHOWN, _COMPARED = 8, 4, 60


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
    study = FrameStudy(
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
    blocks += _refused_photographs(study, start_ns)
    agreement = None
    if settings is not None and study.alone is not None:
        agreement = agreement_section(study.alone.sets, settings.pipeline, start_ns)
    return SecondLook(
        tuple(blocks),
        _answered_photographs(study, start_ns),
        fit_blocks(study.fits, start_ns),
        agreement,
    )


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


def _silent_cameras(recorded: Recorded, settings: HorizonSettings) -> list[Block]:
    """Say which cameras are to be used and have no frames."""
    missing = [name for name in settings.pipeline.cameras if name not in recorded.frames]
    if not missing:
        return []
    timeout_s = nearest_s_from_ns(settings.pipeline.camera_timeout_ns)
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
    slop = settings.pipeline.slop_ns if settings is not None else USUAL_SLOP_NS
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


def _refused_photographs(study: FrameStudy, start_ns: int) -> list[Block]:
    """The frames without an answer."""
    blocks: list[Block] = []
    if study.knows_mounting and any(not look.answered for look in study.looks):
        blocks.append(
            Text(
                "Blue dots: points chosen as the limb. Red crosses: edges that border on "
                "darkness and were thrown away."
            )
        )
    return blocks + _photographs(study, start_ns, answered=False)


def _answered_photographs(study: FrameStudy, start_ns: int) -> Section | None:
    """Frames with an answer, and what was found in them; None without any."""
    blocks: list[Block] = []
    if study.knows_mounting:
        blocks.append(
            Text(
                "Some frames, processed once more, drawn as on ~/debug_image. Yellow dots: "
                "limb points; red crosses: points that the fit threw away. Blue: the fitted "
                "limb, dashed where it is only predicted. White: the way to nadir; in the "
                "corner its one-sigma ellipse."
            )
        )
    photographs = _photographs(study, start_ns, answered=True)
    if not photographs:
        return None
    return Section("frames", "What the cameras saw", (*blocks, *photographs))


def _photographs(study: FrameStudy, start_ns: int, *, answered: bool) -> list[Block]:
    blocks: list[Block] = []
    for look in sorted(study.looks, key=lambda each: each.stamp):
        if look.photos and look.answered == answered:
            when = f"{s_from_ns(look.stamp - start_ns):.2f} s"
            word = "answered" if answered else "no answer"
            why = f": {look.reason.strip()}" if look.reason.strip() else ""
            blocks.append(Photos(tuple(look.photos), f"{when}, {word}{why}"))
    return blocks
