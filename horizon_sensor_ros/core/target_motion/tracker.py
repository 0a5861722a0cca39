"""Clouds of one target in time order -> its pose, and its motion from cloud to cloud."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.seconds import s_from_ns
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.config import TrackerConfig
from horizon_sensor_ros.core.target_motion.noise.temporal_filter import TemporalFilter
from horizon_sensor_ros.core.target_motion.ranges.range_image import cloud_of
from horizon_sensor_ros.core.target_motion.registration import Registration, register
from horizon_sensor_ros.core.target_motion.sweeps.sweep import Sweep, sweep_of
from horizon_sensor_ros.core.target_motion.sweeps.velocity import Velocity
from horizon_sensor_ros.core.target_motion.target_fix import TargetFix
from horizon_sensor_ros.core.target_motion.target_view import (
    TargetView,
    target_view,
    view_of_image,
)
from horizon_sensor_ros.core.target_motion.track import Track, stilled_view


class TargetTracker:
    """Feed clouds in order of time; each comes back as a TargetFix, the same for the same clouds
    and stamps.
    """

    def __init__(self, config: TrackerConfig | None = None) -> None:
        self.config = TrackerConfig() if config is None else config
        self.reset()

    def reset(self, why: str = "first cloud") -> None:
        """Forget everything; the next good cloud sets a new target frame, and says why."""
        self._track: Track | None = None
        # Whether there ever was another cloud than the last fix's.
        self._changing = False
        self._flat: TargetView | None = None
        self._stamp_ns: int | None = None
        self._filter = TemporalFilter()
        self._why = why

    @property
    def stamp_ns(self) -> int | None:
        """Stamp of the last cloud that showed something, by which later ones are judged; None where
        there was none yet.
        """
        return self._stamp_ns

    def process(
        self,
        points: np.ndarray,
        stamp_ns: int,
        anew: str = "",
        times_s: np.ndarray | None = None,
    ) -> TargetFix:
        """Take one cloud, (H, W, 3) organised or (N, 3) plain, metres, in the sensor frame, and
        its stamp. What is outside `TrackerConfig.crop` is no target, but may hide it.

        times_s : (H, W) or (N,) when each point was measured, seconds from the stamp; None: all at
        the stamp. By the target's velocity, which the second cloud tells first, the points are
        brought to where they were at the stamp; so the pose is of the stamp.

        anew : why it says nothing about those before it, where it does not: one that shows
        something sets a new target frame, with that as its reason.

        Bad data never raises; a refused cloud changes nothing but the count of refused ones, and
        how near the next one has to be to what is predicted. A repeated stamp is refused; one that
        lies back in time forgets all there was before. That goes by the clouds that show something:
        a stamp on nothing but NaN says nothing of time. The very same cloud under a new stamp is
        refused, once clouds have changed, where they have noise: it is not of now; after a gap it
        is where a new target frame begins. Raises ValueError for points or times of another shape.
        """
        # Before anything is kept: a caller's bug changes nothing.
        points = cloud_of(points)
        if stamp_ns == self._stamp_ns:
            return TargetFix(Status.REPEATED_STAMP, "a cloud of this stamp was there", stamp_ns)
        return self._processed(points, stamp_ns, anew, times_s)

    def _processed(
        self, points: np.ndarray, stamp_ns: int, anew: str, times_s: np.ndarray | None
    ) -> TargetFix:
        points, cropped = self.config.crop.split(points)
        sweep = None
        if times_s is not None:
            expected = self.config.registration
            sweep = sweep_of(points, times_s, expected.focal_px, expected.min_points, cropped)
        velocity = None if anew else self._velocity_at(stamp_ns)
        view = self._view(points, cropped, sweep, velocity)
        if view.status is not Status.OK:
            where = "" if self.config.crop.everywhere else ", within the box of the crop"
            return self._refuse(view.status, f"{view.reason}{where}", stamp_ns, view, None)
        if anew:
            self.reset(anew)
        elif self._stamp_ns is not None and stamp_ns < self._stamp_ns:
            self.reset("time jumped back")
        track, config = self._track, self.config
        gap_s = 0.0 if track is None else s_from_ns(stamp_ns - track.last.stamp_ns)
        if self._frozen(view, sweep) and gap_s <= config.max_gap_s:
            reason = "the very same cloud again: has the sensor, or its driver, stopped?"
            return self._refuse(Status.REPEATED_CLOUD, reason, stamp_ns, view, None)
        self._stamp_ns = stamp_ns
        if track is None:
            why = self._why
        elif gap_s > config.max_gap_s:
            why = f"no fix for {gap_s:.1f} s"
        else:
            step = track.step_to(view, stamp_ns, sweep, velocity, config)
            if step.keyframe is not None:
                self._flat = None
                return track.accept(step, stamp_ns, sweep, config.keyframe_overlap)
            found = step.found
            why = track.lost(view, found, config)
            if not why:
                return self._refuse(found.status, found.reason, stamp_ns, view, found)
        if sweep is not None and velocity is not None:
            # That was of a target which is lost.
            untouched = self._view(points, cropped, sweep, None)
            view = untouched if untouched.status is Status.OK else view
        return self._start(view, stamp_ns, why, sweep)

    def _velocity_at(self, stamp_ns: int) -> Velocity | None:
        """How the target moves, where that is known; stamps that jumped tell nothing of it."""
        if self._track is None or self._stamp_ns is None or stamp_ns < self._stamp_ns:
            return None
        return self._track.velocity_at(stamp_ns, self.config.max_gap_s)

    def _view(
        self,
        points: np.ndarray,
        cropped: np.ndarray,
        sweep: Sweep | None,
        velocity: Velocity | None,
    ) -> TargetView:
        """A cloud as it would be, had it been measured at its stamp; as it came where that is not
        known.
        """
        config = self.config.registration
        if sweep is None:
            return target_view(points, config, cropped)
        if velocity is None:
            return view_of_image(sweep.image, config)
        return stilled_view(sweep, velocity, config)

    def _frozen(self, view: TargetView, sweep: Sweep | None) -> bool:
        """Whether a cloud is the last fix's to the last bit, although clouds have changed before: a
        live sensor's noise never repeats. Clouds that never did, or have no noise, may be a drawn
        target at rest.
        """
        if self._track is None:
            return False
        same = self._track.is_last(view, sweep)
        self._changing = self._changing or not same
        return same and self._changing and view.has_noise

    def _refuse(
        self,
        status: Status,
        reason: str,
        stamp_ns: int,
        view: TargetView,
        registration: Registration | None,
    ) -> TargetFix:
        kept = 0
        if self._track is not None:
            self._track.miss(refused=registration is not None)
            kept = len(self._track.keyframes)
        return TargetFix(
            status, reason, stamp_ns, registration=registration,
            num_keyframes=kept, num_points=view.image.num_points,
        )  # fmt: skip

    def _start(self, view: TargetView, stamp_ns: int, why: str, sweep: Sweep | None) -> TargetFix:
        assert view.surface is not None
        if view.surface.coplanar:
            # A plane fixes half of the pose, and would keep out the next good cloud; a plate's ends
            # fix the rest, if two clouds in a row show it.
            before, self._flat = self._flat, view
            reason = "all points lie on one plane"
            if before is not None:
                found = register(before, view, self.config.registration)
                reason = "" if found.status is Status.OK else f"{reason}: {found.reason}"
            if reason:
                return self._refuse(Status.ILL_CONDITIONED, reason, stamp_ns, view, None)
        changing, of_driver = self._changing, self._filter
        self.reset()
        self._stamp_ns, self._changing, self._filter = stamp_ns, changing, of_driver
        self._track = Track(view, stamp_ns, sweep, of_driver)
        return self._track.first_fix(why)
