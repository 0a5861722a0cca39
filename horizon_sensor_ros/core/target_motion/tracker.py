"""Clouds of one target in time order -> its pose, and its motion from cloud to cloud."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import (
    inverse_pose,
    pose_matrix,
)
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.config import TrackerConfig
from horizon_sensor_ros.core.target_motion.constant_velocity import (
    predict,
    turn_between,
    unexpected,
    velocity_of,
)
from horizon_sensor_ros.core.target_motion.known_view import (
    KnownView,
    delta_covariance,
)
from horizon_sensor_ros.core.target_motion.noise.temporal_filter import TemporalFilter
from horizon_sensor_ros.core.target_motion.ranges.range_image import cloud_of
from horizon_sensor_ros.core.target_motion.registration import Registration, gainsaid, register
from horizon_sensor_ros.core.target_motion.sweeps.sweep import Sweep, sweep_of
from horizon_sensor_ros.core.target_motion.sweeps.velocity import Velocity, off_m, rotated
from horizon_sensor_ros.core.target_motion.target_fix import TargetFix
from horizon_sensor_ros.core.target_motion.target_view import (
    TargetView,
    target_view,
    view_of_image,
)

# The first cloud defines the target frame; its pose has this variance (rad^2, m^2) rather than
# none.
_DEFINITION_VARIANCE = 1e-8
_MAX_KEYFRAMES = 40
# So many refused clouds in a row that agree outvote a first one that nothing agrees with.
_OUTVOTE = 3
# Fixes before the last one that are kept for the velocity.
_PATH = 8
# So often at most the motion is taken out of a cloud that took time.
_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class _Step:
    """A view, the motion to it, and the keyframe that it is from; None where it is not believed.

    velocity : of the target then, of a cloud that took time.
    """

    view: TargetView
    keyframe: KnownView | None
    found: Registration
    velocity: Velocity | None = None


class TargetTracker:
    """Feed clouds in order of time; each comes back as a TargetFix, the same for the same clouds
    and stamps."""

    def __init__(self, config: TrackerConfig | None = None) -> None:
        self.config = TrackerConfig() if config is None else config
        self.reset()

    def reset(self, why: str = "first cloud") -> None:
        """Forget everything; the next good cloud sets a new target frame, and says why."""
        self._keyframes: list[KnownView] = []
        self._last: KnownView | None = None
        # Whether there ever was another cloud than the last fix's.
        self._changing = False
        # Stamps and poses of the fixes before the last one, the latest first.
        self._path: deque[tuple[int, np.ndarray]] = deque(maxlen=_PATH)
        self._refused = 0
        # Clouds since the last fix, of no use or refused; whether motions to some were doubted.
        self._missed = 0
        self._doubted = False
        self._strayed = False
        self._odd: TargetView | None = None
        self._flat: TargetView | None = None
        self._agreeing = 0
        # Of clouds that took time: the last fix's, and how the target moved then.
        self._sweep: Sweep | None = None
        self._velocity: Velocity | None = None
        self._stamp_ns: int | None = None
        self._filter = TemporalFilter()
        self._why = why

    @property
    def stamp_ns(self) -> int | None:
        """Stamp of the last cloud that showed something, by which later ones are judged; None where
        there was none yet."""
        return self._stamp_ns

    def process(
        self,
        points: np.ndarray,
        stamp_ns: int,
        anew: str = "",
        times_s: np.ndarray | None = None,
    ) -> TargetFix:
        """Take one cloud, (H, W, 3) organised or (N, 3) plain, metres, in the sensor frame, and
        its stamp.

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
        is where a new target frame begins. Raises ValueError for another shape.
        """
        # Before anything is kept: a caller's bug changes nothing.
        points = cloud_of(points)
        if stamp_ns == self._stamp_ns:
            return TargetFix(Status.REPEATED_STAMP, "a cloud of this stamp was there", stamp_ns)
        of = self.config.registration
        sweep = None
        if times_s is not None:
            sweep = sweep_of(points, times_s, of.focal_px, of.min_points)
        velocity = None if anew else self._velocity_at(stamp_ns)
        view = self._view(points, sweep, velocity)
        if view.status is not Status.OK:
            return self._refuse(view.status, view.reason, stamp_ns, view, None)
        if anew:
            self.reset(anew)
        elif self._stamp_ns is not None and stamp_ns < self._stamp_ns:
            self.reset("time jumped back")
        gap_s = 0.0 if self._last is None else (stamp_ns - self._last.stamp_ns) * 1e-9
        if self._frozen(view, sweep) and gap_s <= self.config.max_gap_s:
            reason = "the very same cloud again: has the sensor, or its driver, stopped?"
            return self._refuse(Status.REPEATED_CLOUD, reason, stamp_ns, view, None)
        self._stamp_ns = stamp_ns
        why = self._why
        if self._last is not None:
            if gap_s > self.config.max_gap_s:
                why = f"no fix for {gap_s:.1f} s"
            else:
                step = self._track(view, stamp_ns)
                if step.keyframe is not None and sweep is not None:
                    step = self._stilled(step, step.keyframe, sweep, velocity, stamp_ns)
                if step.keyframe is not None:
                    return self._accept(step, step.keyframe, stamp_ns, sweep)
                registration = step.found
                if self._first_was_odd(view):
                    why = f"first cloud fits none since: {registration.reason}"
                elif self._refused + 1 < self.config.max_refused:
                    return self._refuse(
                        registration.status, registration.reason, stamp_ns, view, registration
                    )
                else:
                    why = f"track lost: {registration.reason}"
        if velocity is not None:
            # That was of a target which is lost.
            untouched = self._view(points, None, None)
            view = untouched if untouched.status is Status.OK else view
        return self._start(view, stamp_ns, why, sweep)

    def _velocity_at(self, stamp_ns: int) -> Velocity | None:
        """How the target moves, where that is known; stamps that jumped tell nothing of it."""
        if self._last is None or self._stamp_ns is None or stamp_ns < self._stamp_ns:
            return None
        gap_s = (stamp_ns - self._last.stamp_ns) * 1e-9
        return self._velocity if gap_s <= self.config.max_gap_s else None

    def _view(
        self, points: np.ndarray, sweep: Sweep | None, velocity: Velocity | None
    ) -> TargetView:
        """A cloud as it would be, had it been measured at its stamp."""
        if sweep is None or velocity is None:
            return target_view(points, self.config.registration)
        return self._stilled_view(sweep, velocity)

    def _stilled_view(self, sweep: Sweep, velocity: Velocity) -> TargetView:
        of = self.config.registration
        return view_of_image(sweep.stilled(velocity, of.focal_px, of.min_points), of)

    def _frozen(self, view: TargetView, sweep: Sweep | None) -> bool:
        """Whether a cloud is the last fix's to the last bit, although clouds have changed before: a
        live sensor's noise never repeats. Clouds that never did, or have no noise, may be a drawn
        target at rest."""
        if self._last is None:
            return False
        if sweep is None or self._sweep is None:
            same = view.image.same_as(self._last.view.image)
        else:
            same = sweep.same_as(self._sweep)
        self._changing = self._changing or not same
        return same and self._changing and view.has_noise

    def _first_was_odd(self, view: TargetView) -> bool:
        """Take a cloud that does not fit the track; whether it and those refused before it agree
        with each other, and nothing has with the first."""
        if self._path:
            return False
        agrees = (
            self._odd is not None
            and register(self._odd, view, self.config.registration).status is Status.OK
        )
        self._odd, self._agreeing = view, self._agreeing + 1 if agrees else 1
        return self._agreeing >= _OUTVOTE

    def _refuse(
        self,
        status: Status,
        reason: str,
        stamp_ns: int,
        view: TargetView,
        registration: Registration | None,
    ) -> TargetFix:
        # A cloud of no use at all says nothing about the track, but the target turned on.
        self._refused += registration is not None
        self._missed += 1
        return TargetFix(
            status, reason, stamp_ns, registration=registration,
            num_keyframes=len(self._keyframes), num_points=view.image.num_points,
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
        centroid = view.image.rot_sensor_from_view @ view.image.centroid_m + view.image.sensor_m
        pose = pose_matrix(np.eye(3), centroid)
        self._filter.start(view.image, view.surface.sigma_m, pose)
        covariance = np.eye(6) * _DEFINITION_VARIANCE
        self._last = KnownView(
            view, stamp_ns, pose, covariance, np.zeros(6), None, np.zeros((6, 6))
        )
        self._sweep = sweep
        self._keyframes = [self._last]
        return TargetFix(
            Status.OK, why, stamp_ns, pose, covariance, new_frame=True,
            num_keyframes=1, num_points=view.image.num_points,
        )  # fmt: skip

    def _track(self, view: TargetView, stamp_ns: int, expected: np.ndarray | None = None) -> _Step:
        """The motion to a view, and the keyframe that it is from.

        expected : (4, 4) pose to begin with, in place of what constant velocity predicts.
        """
        last = self._last
        assert last is not None
        predicted = predict(last, self._path, stamp_ns)
        tried = Registration(Status.POOR_FIT, "")
        refused_by: list[KnownView] = []
        # Nothing tells by how much a target has turned since the last fix that may be like itself.
        turned_rad = (1 + self._missed) * self.config.registration.search_rad
        doubted = False
        begin = predicted if expected is None else expected
        for keyframe in self._candidates(last.pose if begin is None else begin, view):
            prior = None if begin is None else begin @ inverse_pose(keyframe.pose)
            found = register(
                keyframe.view, view, self.config.registration, prior,
                turned_rad=turned_rad, doubted=self._doubted,
            )  # fmt: skip
            doubted = doubted or found.doubted
            if found.status is Status.OK:
                found = self._believed(found, keyframe, predicted, refused_by, view)
            if found.status is Status.OK:
                found = self._of_now(found, keyframe, view)
                return _Step(view, keyframe if found.status is Status.OK else None, found)
            if not tried.reason:
                tried = found
            if np.isfinite(found.part_off_m):
                # From one cloud to the next the part would move too little to tell.
                return _Step(view, None, found)
            refused_by.append(keyframe)
        self._doubted = self._doubted or doubted
        return _Step(view, None, tried)

    def _believed(
        self,
        found: Registration,
        keyframe: KnownView,
        predicted: np.ndarray | None,
        refused_by: list[KnownView],
        view: TargetView,
    ) -> Registration:
        """The motion found from a keyframe; refused where it is not to be expected, or where a view
        from which none was found speaks against it.

        From one cloud to the next a part that moves otherwise, a wall for one, may be too little
        off to tell: what the last view lets through must hold for the kept view too, or small
        steps would add up to the wall's motion.
        """
        if predicted is not None:
            found = self._expected(found, keyframe, predicted)
        if found.status is not Status.OK:
            return found
        for kept in refused_by:
            motion = found.pose_b_from_a @ keyframe.pose @ inverse_pose(kept.pose)
            against = gainsaid(kept.view, view, motion, self.config.registration)
            if against is not None:
                return against
        return found

    def _of_now(self, found: Registration, keyframe: KnownView, view: TargetView) -> Registration:
        """The motion found from a keyframe; refused where the driver averages over clouds: faces
        then are where they were, and outlines where they are."""
        assert view.surface is not None
        pose = found.pose_b_from_a @ keyframe.pose
        if not self._filter.told(view.image, view.surface.sigma_m, pose):
            return found
        reason = (
            "clouds have noise in common, as if averaged over time: is a temporal filter on in"
            " the sensor's driver?"
        )
        return found.refused(Status.POOR_FIT, reason)

    def _expected(
        self, found: Registration, keyframe: KnownView, predicted: np.ndarray
    ) -> Registration:
        """The motion found from a keyframe; refused where it is not what constant velocity lets
        expect."""
        last = self._last
        assert last is not None
        reason = unexpected(found, keyframe, last.pose, predicted, self._strayed)
        if not reason:
            return found
        self._strayed = True
        return found.refused(Status.POOR_FIT, reason)

    def _candidates(self, pose: np.ndarray, view: TargetView) -> list[KnownView]:
        """Keyframes to try: the oldest that the target has not turned too far from, seen from
        about as near; else, and then, the last view."""
        last = self._last
        assert last is not None
        near = [
            k
            for k in self._keyframes
            if turn_between(k.pose, pose) < self.config.keyframe_turn_rad
            and k.view.as_fine_as(view)
        ]
        if not near:
            return [last]
        return [near[0]] if near[0] is last else [near[0], last]

    def _stilled(
        self,
        step: _Step,
        keyframe: KnownView,
        sweep: Sweep,
        used: Velocity | None,
        stamp_ns: int,
    ) -> _Step:
        """Take the motion that was found to a cloud out of that cloud, and out of a first one
        before it until it stays what it is; what it changes by in the end is claimed.

        used : the velocity that is taken out of it already.
        """
        last, keyframes = self._last, self._keyframes
        first = None if self._path else self._sweep
        assert last is not None
        for more in reversed(range(2 if first is None else _ROUNDS)):
            now = KnownView.found(step.view, stamp_ns, keyframe, step.found)
            velocity = velocity_of(now, last, self._path, sweep.mean_s)
            if used is not None:
                off = velocity.difference(used, now.pose[:3, 3])
                velocity = velocity.or_by(off)
                changed = np.diag(sweep.spread_s**2 * np.square(off))
                if not more or off_m(changed, now.size_m) < off_m(now.step_covariance, now.size_m):
                    step = self._known_well(replace(step, velocity=velocity), now, sweep)
                    break
            used = velocity
            views = [self._stilled_view(sweep, used)]
            if first is not None:
                views.append(self._stilled_view(first, used))
                self._last = replace(last, view=views[1], of_sweep=first.error_by(used))
                self._keyframes = [self._last]
            bad = next((each for each in views if each.status is not Status.OK), None)
            if bad is not None:
                step = _Step(bad, None, step.found.refused(bad.status, bad.reason))
                break
            step = self._track(views[0], stamp_ns, now.pose)
            if step.keyframe is None:
                break
            keyframe = step.keyframe
        if step.keyframe is None:
            self._last, self._keyframes = last, keyframes
        return step

    def _known_well(self, step: _Step, now: KnownView, sweep: Sweep) -> _Step:
        """A step; without its keyframe where the velocity leaves more than is allowed."""
        assert step.velocity is not None
        reason = now.uncertain(sweep.error_by(step.velocity), self.config.registration)
        if not reason:
            return step
        return replace(
            step, keyframe=None, found=step.found.refused(Status.ILL_CONDITIONED, reason)
        )

    def _accept(
        self, step: _Step, keyframe: KnownView, stamp_ns: int, sweep: Sweep | None
    ) -> TargetFix:
        last, found = self._last, step.found
        assert last is not None
        if not any(k is keyframe for k in self._keyframes):
            self._keep(keyframe)
        now = KnownView.found(step.view, stamp_ns, keyframe, found)
        self._sweep, self._velocity = sweep, step.velocity
        if sweep is not None and step.velocity is not None:
            now = replace(now, of_sweep=sweep.error_by(step.velocity))
        pose = now.pose
        delta = inverse_pose(last.pose) @ pose
        of_delta = delta_covariance(last, now)
        of_delta += rotated(last.of_sweep + now.of_sweep, last.pose[:3, :3].T)
        of_sweeps = now.of_sweep + rotated(self._keyframes[0].of_sweep, pose[:3, :3])
        # The next cloud is not likely to overlap this keyframe any better.
        if found.overlap < self.config.keyframe_overlap:
            self._keep(now)
        self._path.appendleft((last.stamp_ns, last.pose))
        self._last, self._odd, self._flat = now, None, None
        self._refused, self._missed = 0, 0
        self._doubted = self._strayed = False
        return TargetFix(
            Status.OK, "", stamp_ns, pose,
            now.covariance + np.outer(now.by_bias, now.by_bias) + of_sweeps, delta, of_delta,
            (stamp_ns - last.stamp_ns) * 1e-9, False, found,
            len(self._keyframes), step.view.image.num_points,
        )  # fmt: skip

    def _keep(self, known: KnownView) -> None:
        self._keyframes.append(known)
        if len(self._keyframes) > _MAX_KEYFRAMES:
            # The first one defines the target frame; of the others the oldest goes.
            del self._keyframes[1]
