"""The target since its frame was set: views of it whose poses are known, and the motion to the next
one, held against all of them.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import inverse_pose, pose_matrix, rotated_covariance
from horizon_sensor_ros.core.seconds import s_from_ns
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.config import RegistrationConfig, TrackerConfig
from horizon_sensor_ros.core.target_motion.constant_velocity import (
    predict,
    turn_between,
    unexpected,
    velocity_of,
)
from horizon_sensor_ros.core.target_motion.known_view import KnownView, delta_covariance
from horizon_sensor_ros.core.target_motion.noise.temporal_filter import TemporalFilter
from horizon_sensor_ros.core.target_motion.registration import Registration, contradiction, register
from horizon_sensor_ros.core.target_motion.sweeps.sweep import Sweep
from horizon_sensor_ros.core.target_motion.sweeps.velocity import Velocity, off_m
from horizon_sensor_ros.core.target_motion.target_fix import TargetFix
from horizon_sensor_ros.core.target_motion.target_view import TargetView, view_of_image

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
class TrackStep:
    """A view, the motion to it, and the keyframe that it is from; None where it is not believed.

    velocity : of the target then, of a cloud that took time.
    """

    view: TargetView
    keyframe: KnownView | None
    found: Registration
    velocity: Velocity | None = None


class Track:
    """What is known of one target frame.

    last : view of the last fix.  keyframes : views kept, the first one first.
    """

    def __init__(
        self, view: TargetView, stamp_ns: int, sweep: Sweep | None, of_driver: TemporalFilter
    ) -> None:
        """Set a target frame by a view.

        sweep : of a cloud that took time.  of_driver : what earlier clouds told of it.
        """
        assert view.surface is not None
        centroid = view.image.rot_sensor_from_view @ view.image.centroid_m + view.image.sensor_m
        pose = pose_matrix(np.eye(3), centroid)
        of_driver.start(view.image, view.surface.sigma_m, pose)
        covariance = np.eye(6) * _DEFINITION_VARIANCE
        self.last = KnownView(view, stamp_ns, pose, covariance, np.zeros(6), None, np.zeros((6, 6)))
        self.keyframes = [self.last]
        # Stamps and poses of the fixes before the last one, the latest first.
        self._path: deque[tuple[int, np.ndarray]] = deque(maxlen=_PATH)
        # Of clouds that took time: the last fix's, and how the target moved then.
        self._sweep = sweep
        self._velocity: Velocity | None = None
        self._filter = of_driver
        # Clouds since the last fix: those refused, and with those of no use; whether motions to
        # some were doubted.
        self._refused = self._missed = 0
        self._doubted = self._strayed = False
        self._odd: TargetView | None = None
        self._agreeing = 0

    def first_fix(self, why: str) -> TargetFix:
        """Fix of the first cloud, and why it sets a target frame."""
        first = self.last
        return TargetFix(
            Status.OK, why, first.stamp_ns, first.pose, first.covariance, new_frame=True,
            num_keyframes=1, num_points=first.view.image.num_points,
        )  # fmt: skip

    def velocity_at(self, stamp_ns: int, max_gap_s: float) -> Velocity | None:
        """How the target moves, where that is known."""
        gap_s = s_from_ns(stamp_ns - self.last.stamp_ns)
        return self._velocity if gap_s <= max_gap_s else None

    def is_last(self, view: TargetView, sweep: Sweep | None) -> bool:
        """Whether a cloud is the last fix's, to the last bit."""
        if sweep is None or self._sweep is None:
            return view.image.same_as(self.last.view.image)
        return sweep.same_as(self._sweep)

    def miss(self, *, refused: bool) -> None:
        """Take note of a cloud without a fix; refused : not for being of no use, which says nothing
        about the track. The target turned on.
        """
        self._refused += refused
        self._missed += 1

    def lost(self, view: TargetView, found: Registration, config: TrackerConfig) -> str:
        """Take a cloud that was not let through; why the track ends with it, or empty."""
        if self._first_was_odd(view, config.registration):
            return f"first cloud fits none since: {found.reason}"
        if self._refused + 1 < config.max_refused:
            return ""
        return f"track lost: {found.reason}"

    def step_to(
        self,
        view: TargetView,
        stamp_ns: int,
        sweep: Sweep | None,
        velocity: Velocity | None,
        config: TrackerConfig,
    ) -> TrackStep:
        """The motion to a view. sweep : of a cloud that took time; velocity : by which it is
        stilled, if it is.
        """
        step = self._motion_to(view, stamp_ns, config)
        if step.keyframe is None or sweep is None:
            return step
        before = self.last, self.keyframes
        stilled = None
        try:
            stilled = self._stilled(step, step.keyframe, sweep, velocity, stamp_ns, config)
        finally:
            # Nor does a defect of ours leave views that were stilled by what is not believed.
            if stilled is None or stilled.keyframe is None:
                self.last, self.keyframes = before
        return stilled

    def accept(
        self, step: TrackStep, stamp_ns: int, sweep: Sweep | None, keyframe_overlap: float
    ) -> TargetFix:
        """Take a step that is believed; its fix."""
        last, found, keyframe = self.last, step.found, step.keyframe
        assert keyframe is not None
        now = KnownView.found(step.view, stamp_ns, keyframe, found)
        if sweep is not None and step.velocity is not None:
            now = replace(now, of_sweep=sweep.error_by(step.velocity))
        pose = now.pose
        delta = inverse_pose(last.pose) @ pose
        of_delta = delta_covariance(last, now)
        of_delta += rotated_covariance(last.of_sweep + now.of_sweep, last.pose[:3, :3].T)
        of_sweeps = now.of_sweep + rotated_covariance(self.keyframes[0].of_sweep, pose[:3, :3])
        if not any(k is keyframe for k in self.keyframes):
            self._keep(keyframe)
        # The next cloud is not likely to overlap this keyframe any better.
        if found.overlap < keyframe_overlap:
            self._keep(now)
        self._path.appendleft((last.stamp_ns, last.pose))
        self.last, self._odd = now, None
        self._sweep, self._velocity = sweep, step.velocity
        self._refused, self._missed = 0, 0
        self._doubted = self._strayed = False
        return TargetFix(
            Status.OK,
            "",
            stamp_ns,
            pose_sensor_from_target=pose,
            covariance=now.covariance + np.outer(now.by_bias, now.by_bias) + of_sweeps,
            delta_previous_from_now=delta,
            delta_covariance=of_delta,
            delta_s=s_from_ns(stamp_ns - last.stamp_ns),
            registration=found,
            num_keyframes=len(self.keyframes),
            num_points=step.view.image.num_points,
        )

    def _motion_to(
        self,
        view: TargetView,
        stamp_ns: int,
        config: TrackerConfig,
        expected: np.ndarray | None = None,
    ) -> TrackStep:
        """The motion to a view, and the keyframe that it is from.

        expected : (4, 4) pose to begin with, in place of what constant velocity predicts.
        """
        last = self.last
        predicted = predict(last, self._path, stamp_ns)
        tried = Registration(Status.POOR_FIT, "")
        refused_by: list[KnownView] = []
        # Nothing tells by how much a target has turned since the last fix that may be like itself.
        turned_rad = (1 + self._missed) * config.registration.search_rad
        doubted = False
        begin = predicted if expected is None else expected
        for keyframe in self._candidates(last.pose if begin is None else begin, view, config):
            prior = None if begin is None else begin @ inverse_pose(keyframe.pose)
            found = register(
                keyframe.view, view, config.registration, prior,
                turned_rad=turned_rad, doubted=self._doubted,
            )  # fmt: skip
            doubted = doubted or found.doubted
            if found.status is Status.OK:
                found = self._believed(
                    found, keyframe, predicted, refused_by, view, config.registration
                )
            if found.status is Status.OK:
                found = self._of_now(found, keyframe, view)
                return TrackStep(view, keyframe if found.status is Status.OK else None, found)
            if not tried.reason:
                tried = found
            if np.isfinite(found.part_off_m):
                # From one cloud to the next the part would move too little to tell.
                return TrackStep(view, None, found)
            refused_by.append(keyframe)
        self._doubted = self._doubted or doubted
        return TrackStep(view, None, tried)

    def _believed(
        self,
        found: Registration,
        keyframe: KnownView,
        predicted: np.ndarray | None,
        refused_by: list[KnownView],
        view: TargetView,
        config: RegistrationConfig,
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
            against = contradiction(kept.view, view, motion, config)
            if against is not None:
                return against
        return found

    def _of_now(self, found: Registration, keyframe: KnownView, view: TargetView) -> Registration:
        """The motion found from a keyframe; refused where the driver averages over clouds: faces
        then are where they were, and outlines where they are.
        """
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
        expect.
        """
        last = self.last
        reason = unexpected(found, keyframe, last.pose, predicted, self._strayed)
        if not reason:
            return found
        self._strayed = True
        return found.refused(Status.POOR_FIT, reason)

    def _candidates(
        self, pose: np.ndarray, view: TargetView, config: TrackerConfig
    ) -> list[KnownView]:
        """Keyframes to try: the oldest that the target has not turned too far from, seen from
        about as near; else, and then, the last view.
        """
        last = self.last
        near = [
            k
            for k in self.keyframes
            if turn_between(k.pose, pose) < config.keyframe_turn_rad and k.view.as_fine_as(view)
        ]
        if not near:
            return [last]
        return [near[0]] if near[0] is last else [near[0], last]

    def _stilled(
        self,
        step: TrackStep,
        keyframe: KnownView,
        sweep: Sweep,
        used: Velocity | None,
        stamp_ns: int,
        config: TrackerConfig,
    ) -> TrackStep:
        """Take the motion that was found to a cloud out of that cloud, and out of a first one
        before it until it stays what it is; what it changes by in the end is claimed.

        used : the velocity that is taken out of it already.
        """
        last = self.last
        first = None if self._path else self._sweep
        for more in reversed(range(2 if first is None else _ROUNDS)):
            now = KnownView.found(step.view, stamp_ns, keyframe, step.found)
            velocity = velocity_of(now, last, self._path, sweep.mean_s)
            if used is not None:
                off = velocity.difference(used, now.pose[:3, 3])
                velocity = velocity.less_sure_by(off)
                changed = np.diag(sweep.spread_s**2 * np.square(off))
                if not more or off_m(changed, now.size_m) < off_m(now.step_covariance, now.size_m):
                    step = _known_well(
                        replace(step, velocity=velocity), now, sweep, config.registration
                    )
                    break
            used = velocity
            views = [stilled_view(sweep, used, config.registration)]
            if first is not None:
                views.append(stilled_view(first, used, config.registration))
                self.last = replace(last, view=views[1], of_sweep=first.error_by(used))
                self.keyframes = [self.last]
            bad = next((each for each in views if each.status is not Status.OK), None)
            if bad is not None:
                step = TrackStep(bad, None, step.found.refused(bad.status, bad.reason))
                break
            step = self._motion_to(views[0], stamp_ns, config, now.pose)
            if step.keyframe is None:
                break
            keyframe = step.keyframe
        return step

    def _first_was_odd(self, view: TargetView, config: RegistrationConfig) -> bool:
        """Take a cloud that does not fit the track; whether it and those refused before it agree
        with each other, and nothing has with the first.
        """
        if self._path:
            return False
        agrees = self._odd is not None and register(self._odd, view, config).status is Status.OK
        self._odd, self._agreeing = view, self._agreeing + 1 if agrees else 1
        return self._agreeing >= _OUTVOTE

    def _keep(self, known: KnownView) -> None:
        self.keyframes.append(known)
        if len(self.keyframes) > _MAX_KEYFRAMES:
            # The first one defines the target frame; of the others the oldest goes.
            del self.keyframes[1]


def stilled_view(sweep: Sweep, velocity: Velocity, config: RegistrationConfig) -> TargetView:
    """A cloud that took time as it would be, had it been measured at its stamp."""
    return view_of_image(sweep.stilled(velocity, config.focal_px, config.min_points), config)


def _known_well(
    step: TrackStep, now: KnownView, sweep: Sweep, config: RegistrationConfig
) -> TrackStep:
    """A step; without its keyframe where the velocity leaves more than is allowed."""
    assert step.velocity is not None
    reason = now.uncertain(sweep.error_by(step.velocity), config)
    if not reason:
        return step
    return replace(step, keyframe=None, found=step.found.refused(Status.ILL_CONDITIONED, reason))
