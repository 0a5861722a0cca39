"""The whole horizon chain: simultaneous frames of N cameras in, nadir and altitude out, or the
reason why not. Where the last fix predicts the limb it is followed, else searched for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.aiding import NOTHING_KNOWN, Aiding
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.cameras.readout import view_at_stamp
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.craft_fixed import CraftFixed
from horizon_sensor_ros.core.horizon.doubts import Doubts
from horizon_sensor_ros.core.horizon.estimator import HorizonEstimator
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.judgement import nadir_sigma_rad
from horizon_sensor_ros.core.horizon.leaps import Leaps
from horizon_sensor_ros.core.horizon.lost_rows import lost_rows
from horizon_sensor_ros.core.horizon.nadir_rate import NadirRate
from horizon_sensor_ros.core.horizon.repeated_images import RepeatedImages
from horizon_sensor_ros.core.horizon.search import HorizonSearch
from horizon_sensor_ros.core.horizon.sighting import Sighting
from horizon_sensor_ros.core.horizon.track import Track
from horizon_sensor_ros.core.limb.detection import Detection
from horizon_sensor_ros.core.limb.detector import follow_limb
from horizon_sensor_ros.core.limb.search.selection import MIN_INLIERS
from horizon_sensor_ros.core.limb.sun_streak import without_streaks
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.motion.gyro_trust import GyroTrust
from horizon_sensor_ros.core.motion.turn_rate import TurnRate, rate_by_gyro
from horizon_sensor_ros.core.planet_figure import Disc
from horizon_sensor_ros.core.status import Status

# Longer side of a frame over the shorter one.
_MOST_LENGTHY = 100.0
# Sets of frames followed before the whole frames are searched again: a track that had slipped off
# the limb, or a camera that has come to see it, is noticed after so many at the latest.
_LONGEST_TRACK = 50
_MANY_MORE = 2.0  # times the edges that agreed on a disc when a camera was searched
_MOST_TURN_RAD = 0.1  # within a set: farther, and rays have no one row in which they are seen
_OF_SIGMA = 0.3  # of nadir: what an unknown rate makes that is told
# How frames end that are brought together by a rate that is not theirs.
_OF_A_WRONG_RATE = (Status.CAMERAS_DISAGREE, Status.POOR_FIT)
_NOT_THE_GYROS = "with the rate on imu no horizon fits, without it one does: it is not used"
_NOT_THE_FIXES = (
    "the rate on imu is not the one by which the horizon moves, or was not just now: it is not used"
)
_NO_TIME = "which cameras see a limb depends on the time at which they are asked"
_NO_RATE = "frames are not of one moment, and how fast the craft turns is not known"


class HorizonSensor:
    """Frames of any number of cameras to nadir and altitude."""

    def __init__(self, config: HorizonConfig | None = None) -> None:
        self.config = HorizonConfig() if config is None else config
        self._estimator = HorizonEstimator(self.config)
        self._search = HorizonSearch(self._estimator)
        self.reset()

    def reset(self) -> None:
        """Forget all frames: the next ones are searched."""
        self._track: Track | None = None
        self._nadir_rate = NadirRate()
        self._gyro_trust = GyroTrust()
        self._doubts = Doubts()
        self._craft_fixed = CraftFixed()
        self._leaps = Leaps()
        self._images = RepeatedImages()
        self._timed_by, self._time_s = "", 0.0  # the last fix's, its time after that of its set

    @property
    def following(self) -> bool:
        """Whether the last fix came from following the limb, not from a search."""
        return self._track is not None and self._track.age > 0

    def process(self, frames: Sequence[Frame], aiding: Aiding = NOTHING_KNOWN) -> HorizonFix:
        """Find the horizon in simultaneous frames, with what is known of them from elsewhere.

        Frames that are not of one moment (`Frame.after_s`, `CameraView.readout_s`) are brought to
        that of the first camera in the fix. What motion smears during a `CameraView.exposure_s` is
        known where the rate is, and else measured.
        A camera whose frame shows no trustworthy limb, or that is frozen (`RepeatedImages`), is
        left out and the others decide; its entry in `limbs` says why. One that contradicted the
        others before is not believed alone (`Doubts`), nor one whose limb does not move when the
        craft turns (`CraftFixed`), or lies where no craft comes so soon (`Leaps`). Raises
        ValueError for no frames at all, cameras of one name, or an image that is not (H, W) uint8
        or uint16; a frame of another size than its camera's is refused with status BAD_IMAGE.
        """
        if len(frames) == 0:
            raise ValueError("frames must hold at least one frame")
        names = [frame.view.name for frame in frames]
        if len(set(names)) < len(names):
            raise ValueError(f"cameras must have names of their own, got {', '.join(names)}")
        frames = self._images.marked(frames, aiding)
        before_s, self._time_s = self._time_s, 0.0
        if any(frame.takes_s > 0.0 for frame in frames):
            fix = self._brought_together(frames, aiding)
        else:
            fix = self._processed(frames, frames, aiding)
        fix = self._believed(fix, aiding)
        since_last_s = aiding.since_last_s
        if since_last_s is not None:
            # From fix to fix, each at the time of its own first camera.
            since_last_s += self._time_s - before_s
        known = since_last_s is not None and since_last_s > 0.0
        self._nadir_rate.add(fix.fit, since_last_s if known else None)
        return fix

    def _believed(self, fix: HorizonFix, aiding: Aiding) -> HorizonFix:
        """Fix, or none where frames before, or how the craft moves, speak against it."""
        doubt = self._doubts.against(fix, followed=fix.predicted is not None)
        if doubt:
            fix = self._not_believed(fix, Status.CAMERAS_DISAGREE, doubt)
        still = self._craft_fixed.against(fix, aiding)
        if still and fix.of_several:
            # No part of the craft looks like one horizon to several cameras.
            fix = _told_besides(fix, still)
        elif still:
            fix = self._not_believed(fix, Status.POOR_FIT, still)
            self._leaps.reset()
        leap = self._leaps.against(fix, aiding)
        return self._not_believed(fix, Status.POOR_FIT, leap) if leap else fix

    def _not_believed(self, fix: HorizonFix, status: Status, reason: str) -> HorizonFix:
        """No fix, where there is one that is not believed; what it is of is not followed."""
        self._track = None
        refused = self._estimator.refused(status, reason, fix.fit, fix.limbs)
        return replace(refused, views=fix.views)

    def _brought_together(self, frames: Sequence[Frame], aiding: Aiding) -> HorizonFix:
        """Fix of frames that are not of one moment, at that of the first camera that is in it."""
        by_fixes = self._nadir_rate.now(self.config.rate_sigma_rad_s)
        gyro_rate = rate_by_gyro(aiding)
        if gyro_rate is None:
            return self._at_rate(frames, by_fixes, aiding)
        # Nor is the age of a coarse pose counted by a gyro that is not believed.
        unaided = replace(aiding, rate_base_rad_s=None)
        if not self._gyro_trust.believes(gyro_rate, by_fixes, aiding.since_last_s):
            return _without_gyro(self._at_rate(frames, by_fixes, unaided), _NOT_THE_FIXES)
        fix = self._at_rate(frames, gyro_rate, aiding)
        # A rate by which frames of one moment are no more than smeared bends no horizon.
        late = any(frame.late_s > 0.0 for frame in frames)
        if not late or fix.status not in _OF_A_WRONG_RATE:
            return fix
        # Only fixes contradict a gyro, and with one that is far off there may never be any.
        without = self._at_rate(frames, by_fixes, unaided)
        if not without.ok:
            return fix
        self._gyro_trust.refute()
        return _without_gyro(without, _NOT_THE_GYROS)

    def _at_rate(
        self, frames: Sequence[Frame], known_rate: TurnRate | None, aiding: Aiding
    ) -> HorizonFix:
        """Fix of frames that are not of one moment, of a craft that turns so fast.

        known_rate : None where that is not known.
        """
        rate = known_rate or TurnRate(np.zeros(3), self.config.rate_sigma_rad_s)
        turn_rad = max(frame.takes_s for frame in frames) * float(
            np.linalg.norm(rate.rate_base_rad_s)
        )
        if turn_rad > _MOST_TURN_RAD:
            self._track = None
            return self._too_fast(frames, turn_rad)
        fix = self._at_its_own(frames, rate, aiding)
        open_rad = max(frame.late_s for frame in frames) * rate.sigma_rad_s
        if fix.ok and known_rate is None and open_rad > _OF_SIGMA * nadir_sigma_rad(fix.fit):
            return _told_besides(fix, _NO_RATE)
        return fix

    def _at_its_own(self, frames: Sequence[Frame], rate: TurnRate, aiding: Aiding) -> HorizonFix:
        """Fix at the time of the first camera that is in it."""
        times = {frame.view.name: frame.after_s for frame in frames}
        time_s, track = times.get(self._timed_by, 0.0), self._track
        # Which cameras are in it may depend on the time at which they are asked.
        for _ in range(len(frames) + 1):
            self._track = track
            fix = self._at(time_s, frames, rate, aiding)
            if not fix.ok:
                return fix
            first = next(name for name in times if name in fix.cameras_used)
            if times[first] == time_s:
                self._timed_by, self._time_s = first, time_s
                return fix
            time_s = times[first]
        self._track = None
        return self._withheld(frames, _NO_TIME)

    def _too_fast(self, frames: Sequence[Frame], turn_rad: float) -> HorizonFix:
        """No fix of frames between which, or while one of which is read, the craft turns far."""
        most, turn = np.degrees((_MOST_TURN_RAD, turn_rad))
        reason = (
            f"the craft turns by {turn:.0f} deg within a set of frames, at most {most:.0f} will do"
        )
        return self._withheld(frames, reason)

    def _withheld(self, frames: Sequence[Frame], reason: str) -> HorizonFix:
        limb = LimbPoints.none(Status.UNCERTAIN, reason)
        fit = HorizonFit.none(limb.status, reason, self.config.method)
        return HorizonFix(limb.status, reason, fit, (limb,) * len(frames), ())

    def _at(
        self, time_s: float, frames: Sequence[Frame], rate: TurnRate, aiding: Aiding
    ) -> HorizonFix:
        """Fix of frames as they are seen at a time after that of the set."""
        seen = [
            replace(frame, view=view_at_stamp(frame.view, rate, frame.after_s - time_s))
            for frame in frames
        ]
        fix = self._processed(frames, seen, aiding)
        return replace(fix, views=tuple(frame.view for frame in seen))

    def _processed(
        self, given: Sequence[Frame], frames: Sequence[Frame], aiding: Aiding
    ) -> HorizonFix:
        """Fix of frames. given : the same frames, each with the view it was called with, by which a
        track knows its camera again; frames have views that motion has moved.
        """
        unusable = [_unusable(frame) for frame in frames]
        frames = [
            frame if limb is not None else _without_streaks(frame)
            for frame, limb in zip(frames, unusable, strict=True)
        ]
        usable = [i for i, limb in enumerate(unusable) if limb is None]
        views = [given[i].view for i in usable]
        # What raises, or is not followed, leaves no track: the next set is searched.
        before, self._track = self._track, None
        numbers = None if before is None else before.numbers(views)
        if before is not None and numbers is not None:
            followed = self._follow([frames[i] for i in usable], before, numbers, aiding)
            if followed is not None and len(usable) < len(frames):
                limbs = iter(followed.limbs)
                followed = replace(followed, limbs=tuple(limb or next(limbs) for limb in unusable))
            if followed is not None:
                return followed
        fix, detection = self._search.fix(frames, unusable, aiding)
        to_be_followed = self.config.tracking and fix.fit.disc is not None
        if to_be_followed and detection is not None and detection.modelled:
            track = self._started(views, frames, fix, detection)
            self._track = track.after(before, aiding.since_last_s)
        return fix

    def _started(
        self,
        views: Sequence[CameraView],
        frames: Sequence[Frame],
        fix: HorizonFix,
        detection: Detection,
    ) -> Track:
        """Track from a search. views : of the frames that were looked at. frames : all of them."""
        cameras = fix.cameras_on_cone(views)
        shows = detection.below_layer or fix.airglow is not None
        by_name = {frame.view.name: frame for frame in frames}
        outside = [view.name for view in views if view.name not in cameras]
        limbs = dict(zip(by_name, fix.limbs, strict=True))
        return Track.started(
            views,
            replace(detection, airglow=shows),
            fix.fit,
            cameras,
            {name: self._search.agreeing(by_name[name]) for name in outside},
            {name: limb.reason for name, limb in limbs.items() if name in fix.contradicting},
        )

    def _follow(
        self, frames: Sequence[Frame], track: Track, numbers: Sequence[int], aiding: Aiding
    ) -> HorizonFix | None:
        """Fix from where the limb is expected; None where a search has to say what is there.

        numbers : of the frames, among the track's.
        """
        views = [frame.view for frame in frames]
        if track.age >= _LONGEST_TRACK or self._sees_more(frames, track):
            return None
        nadir, rho = track.predicted_cone(aiding.rot_now_from_last, aiding.since_last_s)
        figure = self._estimator.figure(aiding).aligned(nadir)
        images = [frame.gray for frame in frames]
        detection = follow_limb(
            [figure.view(view) for view in views],
            images,
            self._estimator.sphere,
            (nadir, rho),
            track.state.of(numbers),
        )
        if detection is None:
            return None
        working = tuple(
            track.working[i].sampled(image) for i, image in zip(numbers, images, strict=True)
        )
        detection = replace(
            detection, working=working, layer_rad=track.layer_rad, airglow=track.airglow
        )
        moves_rad_s = track.moves_rad_s(aiding.rot_now_from_last, aiding.since_last_s)
        sighting = Sighting(frames, detection, figure, aiding, moves_rad_s)
        # Where a frame is doubtful the fix is not OK, and a search follows.
        fix = self._estimator.judged(sighting).fix
        fix, detection = self._estimator.prefer_separated(sighting, fix)
        expected = tuple(view.name for view in views if view.name in track.cameras)
        if not fix.ok or fix.cameras_on_cone(views) != expected:
            return None
        self._track = track.continued(numbers, detection, fix.fit, aiding.since_last_s)
        # Near the others' limb there is none of such a camera, which says nothing of why.
        limbs = tuple(
            replace(limb, reason=track.elsewhere[view.name])
            if view.name in track.elsewhere
            else limb
            for view, limb in zip(views, fix.limbs, strict=True)
        )
        return replace(fix, limbs=limbs, predicted=Disc(figure, nadir, rho))

    def _sees_more(self, frames: Sequence[Frame], track: Track) -> bool:
        """Whether a camera that is not in the track has come to see what may be a limb.

        It need not be the one that is followed. They are asked in turn, one a set.
        """
        outside = [frame for frame in frames if frame.view.name in track.outside]
        if not outside:
            return False
        frame = outside[track.age % len(outside)]
        most = _MANY_MORE * track.outside[frame.view.name] + MIN_INLIERS
        return self._search.agreeing(frame) > most


def _without_gyro(fix: HorizonFix, reason: str) -> HorizonFix:
    """Fix of frames brought together without the gyro's rate, and why; of none, nothing is said."""
    return replace(_told_besides(fix, reason), gyro_refused=True) if fix.ok else fix


def _told_besides(fix: HorizonFix, reason: str) -> HorizonFix:
    """Fix with one more thing that makes it less certain."""
    return replace(fix, reason="; ".join(filter(None, (fix.reason, reason))))


def _without_streaks(frame: Frame) -> Frame:
    gray = without_streaks(frame.gray)
    return frame if gray is frame.gray else replace(frame, gray=gray)


def _unusable(frame: Frame) -> LimbPoints | None:
    gray, camera = frame.gray, frame.view.camera
    if (
        not isinstance(gray, np.ndarray)
        or gray.ndim != 2
        or gray.dtype not in (np.uint8, np.uint16)
    ):
        got = f"{getattr(gray, 'dtype', type(gray))} {getattr(gray, 'shape', '')}"
        raise ValueError(f"gray of {frame.view.name} must be (H, W) uint8 or uint16, got {got}")
    if gray.shape != (camera.height, camera.width):
        return LimbPoints.none(
            Status.BAD_IMAGE,
            f"image of {gray.shape[1]} x {gray.shape[0]}, "
            f"camera of {camera.width} x {camera.height}",
        )
    if frame.unusable:
        return LimbPoints.none(Status.BAD_IMAGE, frame.unusable)
    # Much longer than wide, nothing is left of the width in the size that limbs are looked for in.
    if min(gray.shape) < max(16, max(gray.shape) / _MOST_LENGTHY):
        size = f"{gray.shape[1]} x {gray.shape[0]}"
        return LimbPoints.none(Status.BAD_IMAGE, f"image of {size} is too small or too narrow")
    lost = lost_rows(gray, frame.view.mask)
    return LimbPoints.none(Status.BAD_IMAGE, lost) if lost else None
