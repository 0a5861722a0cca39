"""Clouds of one target in time order -> its pose, and its motion from cloud to cloud."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import (
    inverse_pose,
    pose_matrix,
    rotation_from_vector,
    skew,
    vector_from_rotation,
)
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.config import TrackerConfig
from horizon_sensor_ros.core.target_motion.noise.temporal_filter import TemporalFilter
from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage, cloud_of
from horizon_sensor_ros.core.target_motion.registration import Registration, gainsaid, register
from horizon_sensor_ros.core.target_motion.target_view import TargetView, target_view

# The first cloud defines the target frame; its pose has this variance (rad^2, m^2) rather than
# none.
_DEFINITION_VARIANCE = 1e-8
_MAX_KEYFRAMES = 40
# Views of which one's pixels are so many times as wide on the target as the other's show different
# things: what is smaller than the wider ones these smear.
_OTHER_SCALE = 2.0
# Noise of a real sensor over a pixel's width on the target, at least: of good ones it is a tenth.
_LEAST_NOISE = 0.01
# So many refused clouds in a row that agree outvote a first one that nothing agrees with.
_OUTVOTE = 3
# A turn may be off what constant velocity predicts by half a side of a prism of eight: farther off
# a turn by a side less or more, which looks the same, is the likelier one. After one that was
# refused for that, by no more than a prior may be off: what looks the same may come to lie nearer
# as the prediction goes on.
_UNSTEADY_RAD, _STRAYED_RAD = np.radians([22.0, 10.0])
# And by no more than some times the turn that is predicted, where that is more than a few degrees:
# what little holds the roll of a slow target may leave the view.
_STEADY_RAD, _STEADY = np.radians(5.0), 3.0
# It may be moved so far from what is predicted, rms radii of what is seen and shares of the range
# (as if the sensor had turned): farther off it is another bay of a truss, or rung, or panel.
_ASIDE, _ASIDE_RAD = 0.3, np.radians(3.0)
# A velocity is carried on for so many times what it was taken over, where enough fixes are kept,
# and never for more than the second: of stamps as clouds arrive two may lie close together.
_CARRIED_ON, _MOST_CARRIED_ON, _PATH = 4, 20, 8


@dataclass(frozen=True, eq=False)
class TargetFix:
    """What one cloud tells.

    status, reason : OK, or why there is nothing to publish.
    pose_sensor_from_target : (4, 4) the target frame in the sensor frame.  covariance : (6, 6) of
        (rotation vector about the sensor's fixed axes, position of the frame's origin), rad and m;
        since the target frame was set.
    delta_previous_from_now : (4, 4) the target frame now in the target frame at the previous fix:
        inv(pose_previous) pose_now; None for the first cloud of a target frame.  delta_covariance
        : (6, 6) of that step, (rotation vector about the previous target frame's axes, position).
        delta_s : stamps' difference.
    new_frame : this cloud set the target frame, because of ``reason`` (first cloud, gap, lost
        track, odd first cloud, time jumped back).
    registration : the last one tried; None where there was none.  num_keyframes : kept views of
        the target.
    num_points : returns in the cloud, see `range_image`.
    Poses and covariances are NaN unless the status is OK.
    """

    status: Status
    reason: str
    stamp_ns: int
    pose_sensor_from_target: np.ndarray = field(default_factory=lambda: np.full((4, 4), np.nan))
    covariance: np.ndarray = field(default_factory=lambda: np.full((6, 6), np.nan))
    delta_previous_from_now: np.ndarray | None = None
    delta_covariance: np.ndarray | None = None
    delta_s: float = float("nan")
    new_frame: bool = False
    registration: Registration | None = None
    num_keyframes: int = 0
    num_points: int = 0


@dataclass(frozen=True, eq=False)
class _Known:
    """A view whose pose is known: how it was found, and its covariance in parts.

    covariance : of its pose, by noise; by_bias : (6,) its error by what is wrong with all ranges,
        one sigma, which is the same in all poses.
    keyframe_ns : stamp of the view it was registered to; None for the first one. No more than the
        stamp, as a reference would keep every view since the first one alive.
    """

    view: TargetView
    stamp_ns: int
    pose: np.ndarray
    covariance: np.ndarray
    by_bias: np.ndarray
    keyframe_ns: int | None
    step_covariance: np.ndarray


class TargetTracker:
    """Feed clouds in order of time; each comes back as a TargetFix, the same for the same clouds
    and stamps."""

    def __init__(self, config: TrackerConfig | None = None) -> None:
        self.config = TrackerConfig() if config is None else config
        self.reset()

    def reset(self, why: str = "first cloud") -> None:
        """Forget everything; the next good cloud sets a new target frame, and says why."""
        self._keyframes: list[_Known] = []
        self._last: _Known | None = None
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
        self._stamp_ns: int | None = None
        self._filter = TemporalFilter()
        self._why = why

    @property
    def stamp_ns(self) -> int | None:
        """Stamp of the last cloud that showed something, by which later ones are judged; None where
        there was none yet."""
        return self._stamp_ns

    def process(self, points: np.ndarray, stamp_ns: int, anew: str = "") -> TargetFix:
        """Take one cloud, (H, W, 3) organised or (N, 3) plain, metres, in the sensor frame, and
        its stamp.

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
        view = target_view(points, self.config.registration)
        if view.status is not Status.OK:
            return self._refuse(view.status, view.reason, stamp_ns, view, None)
        if anew:
            self.reset(anew)
        elif self._stamp_ns is not None and stamp_ns < self._stamp_ns:
            self.reset("time jumped back")
        gap_s = 0.0 if self._last is None else (stamp_ns - self._last.stamp_ns) * 1e-9
        if self._frozen(view) and gap_s <= self.config.max_gap_s:
            reason = "the very same cloud again: has the sensor, or its driver, stopped?"
            return self._refuse(Status.REPEATED_CLOUD, reason, stamp_ns, view, None)
        self._stamp_ns = stamp_ns
        why = self._why
        if self._last is not None:
            if gap_s > self.config.max_gap_s:
                why = f"no fix for {gap_s:.1f} s"
            else:
                fix, registration = self._track(view, stamp_ns)
                if fix is not None:
                    return fix
                if self._first_was_odd(view):
                    why = f"first cloud fits none since: {registration.reason}"
                elif self._refused + 1 < self.config.max_refused:
                    return self._refuse(
                        registration.status, registration.reason, stamp_ns, view, registration
                    )
                else:
                    why = f"track lost: {registration.reason}"
        return self._start(view, stamp_ns, why)

    def _frozen(self, view: TargetView) -> bool:
        """Whether a cloud is the last fix's to the last bit, although clouds have changed before: a
        live sensor's noise never repeats. Clouds that never did, or have no noise, may be a drawn
        target at rest."""
        if self._last is None:
            return False
        same = _same(self._last.view.image, view.image)
        self._changing = self._changing or not same
        return same and self._changing and _has_noise(view)

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

    def _start(self, view: TargetView, stamp_ns: int, why: str) -> TargetFix:
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
        centroid = view.image.rot_sensor_from_view @ view.image.centroid_m
        pose = pose_matrix(np.eye(3), centroid)
        self._filter.start(view.image, view.surface.sigma_m, pose)
        covariance = np.eye(6) * _DEFINITION_VARIANCE
        self._last = _Known(view, stamp_ns, pose, covariance, np.zeros(6), None, np.zeros((6, 6)))
        self._keyframes = [self._last]
        return TargetFix(
            Status.OK, why, stamp_ns, pose, covariance, new_frame=True,
            num_keyframes=1, num_points=view.image.num_points,
        )  # fmt: skip

    def _track(self, view: TargetView, stamp_ns: int) -> tuple[TargetFix | None, Registration]:
        last = self._last
        assert last is not None
        predicted = self._predict(stamp_ns)
        tried = Registration(Status.POOR_FIT, "")
        refused_by: list[_Known] = []
        # Nothing tells by how much a target has turned since the last fix that may be like itself.
        turned_rad = (1 + self._missed) * self.config.registration.search_rad
        doubted = False
        for keyframe in self._candidates(last.pose if predicted is None else predicted, view):
            prior = None if predicted is None else predicted @ inverse_pose(keyframe.pose)
            found = register(
                keyframe.view, view, self.config.registration, prior,
                turned_rad=turned_rad, doubted=self._doubted,
            )  # fmt: skip
            doubted = doubted or found.doubted
            if found.status is Status.OK:
                found = self._believed(found, keyframe, predicted, refused_by, view)
            if found.status is Status.OK:
                found = self._of_now(found, keyframe, view)
                of_now = found.status is Status.OK
                return self._accept(keyframe, found, view, stamp_ns) if of_now else None, found
            if not tried.reason:
                tried = found
            if np.isfinite(found.part_off_m):
                # From one cloud to the next the part would move too little to tell.
                return None, found
            refused_by.append(keyframe)
        self._doubted = self._doubted or doubted
        return None, tried

    def _believed(
        self,
        found: Registration,
        keyframe: _Known,
        predicted: np.ndarray | None,
        refused_by: list[_Known],
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

    def _of_now(self, found: Registration, keyframe: _Known, view: TargetView) -> Registration:
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

    def _predict(self, stamp_ns: int) -> np.ndarray | None:
        """Pose from the last one and constant velocity; None before there is a velocity."""
        last = self._last
        if last is None or not self._path:
            return None
        gap_ns = stamp_ns - last.stamp_ns
        far = (each for each in self._path if _CARRIED_ON * (last.stamp_ns - each[0]) >= gap_ns)
        before_ns, before = next(far, self._path[-1])
        ratio = gap_ns / (last.stamp_ns - before_ns)
        if ratio > _MOST_CARRIED_ON:
            return None
        delta = inverse_pose(before) @ last.pose
        turn = rotation_from_vector(vector_from_rotation(delta[:3, :3]) * ratio)
        return last.pose @ pose_matrix(turn, delta[:3, 3] * ratio)

    def _expected(
        self, found: Registration, keyframe: _Known, predicted: np.ndarray
    ) -> Registration:
        """The motion found from a keyframe; refused where the target would have turned or moved
        otherwise than constant velocity lets expect.

        What a prior does not lead to is searched for about no turn, and on a nearly symmetric
        target a turn by a side less, or by a right angle, agrees as well; on a truss a shift by a
        bay.
        """
        now = found.pose_b_from_a @ keyframe.pose
        reason = self._turned_off(now, predicted) or _moved_off(found, keyframe, now, predicted)
        if not reason:
            return found
        self._strayed = True
        return found.refused(Status.POOR_FIT, reason)

    def _turned_off(self, pose: np.ndarray, predicted: np.ndarray) -> str:
        """Why a pose (4, 4) is turned too far from the one predicted; empty where it is not."""
        last = self._last
        assert last is not None
        off, turn = _angle(pose, predicted), _angle(last.pose, predicted)
        most = _STRAYED_RAD if self._strayed else _UNSTEADY_RAD
        most = min(most, max(_STEADY_RAD, _STEADY * turn))
        if off <= most:
            return ""
        return (
            f"turned {np.degrees(off):.0f} deg away from the {np.degrees(turn):.0f} deg that"
            f" constant velocity predicts, {np.degrees(most):.0f} allowed"
        )

    def _candidates(self, pose: np.ndarray, view: TargetView) -> list[_Known]:
        """Keyframes to try: the oldest that the target has not turned too far from, seen from
        about as near; else, and then, the last view."""
        last = self._last
        assert last is not None
        near = [
            k
            for k in self._keyframes
            if _angle(k.pose, pose) < self.config.keyframe_turn_rad and _as_fine(k.view, view)
        ]
        if not near:
            return [last]
        return [near[0]] if near[0] is last else [near[0], last]

    def _accept(
        self, keyframe: _Known, found: Registration, view: TargetView, stamp_ns: int
    ) -> TargetFix:
        last = self._last
        assert last is not None
        if not any(k is keyframe for k in self._keyframes):
            self._keep(keyframe)
        pose = found.pose_b_from_a @ keyframe.pose
        by_bias = found.by_bias_at(pose[:3, 3])
        step = found.covariance_at(pose[:3, 3]) - np.outer(by_bias, by_bias)
        turn = np.kron(np.eye(2), found.pose_b_from_a[:3, :3])
        covariance = step + turn @ keyframe.covariance @ turn.T
        by_bias = by_bias + turn @ keyframe.by_bias
        now = _Known(view, stamp_ns, pose, covariance, by_bias, keyframe.stamp_ns, step)
        delta = inverse_pose(last.pose) @ pose
        delta_covariance = _delta_covariance(last, now)
        # The next cloud is not likely to overlap this keyframe any better.
        if found.overlap < self.config.keyframe_overlap:
            self._keep(now)
        self._path.appendleft((last.stamp_ns, last.pose))
        self._last, self._odd, self._flat = now, None, None
        self._refused, self._missed = 0, 0
        self._doubted = self._strayed = False
        return TargetFix(
            Status.OK, "", stamp_ns, pose, covariance + np.outer(by_bias, by_bias), delta,
            delta_covariance,
            (stamp_ns - last.stamp_ns) * 1e-9, False, found,
            len(self._keyframes), view.image.num_points,
        )  # fmt: skip

    def _keep(self, known: _Known) -> None:
        self._keyframes.append(known)
        if len(self._keyframes) > _MAX_KEYFRAMES:
            # The first one defines the target frame; of the others the oldest goes.
            del self._keyframes[1]


def _as_fine(a: TargetView, b: TargetView) -> bool:
    """Whether both views are about as fine on the target."""
    assert a.surface is not None
    assert b.surface is not None
    wider = max(a.surface.footprint_m, b.surface.footprint_m)
    return wider < _OTHER_SCALE * min(a.surface.footprint_m, b.surface.footprint_m)


def _has_noise(view: TargetView) -> bool:
    """Whether ranges have noise, as a sensor's do and a drawn target's need not."""
    assert view.surface is not None
    return view.surface.sigma_m > _LEAST_NOISE * view.surface.footprint_m


def _same(image: RangeImage, other: RangeImage) -> bool:
    """Whether two images are of the same returns, to the last bit."""
    # The mean tells nearly all others apart, at no cost.
    return (
        image.num_points == other.num_points
        and np.array_equal(image.centroid_m, other.centroid_m)
        and np.array_equal(image.inverse_depth, other.inverse_depth)
    )


def _moved_off(
    found: Registration, keyframe: _Known, pose: np.ndarray, predicted: np.ndarray
) -> str:
    """Why what a keyframe shows is, by a pose (4, 4), too far from where it is predicted; empty
    where it is not.
    """
    assert keyframe.view.surface is not None
    centre = np.append(found.centre_m, 1.0)
    before = predicted @ inverse_pose(pose) @ centre
    off_m = float(np.linalg.norm(centre - before))
    range_m = float(np.linalg.norm(found.centre_m))
    most_m = _ASIDE * keyframe.view.surface.size_m + _ASIDE_RAD * range_m
    if off_m <= most_m:
        return ""
    return f"{off_m:.2f} m away from where constant velocity predicts it, {most_m:.2f} allowed"


def _angle(pose_a: np.ndarray, pose_b: np.ndarray) -> float:
    return float(np.linalg.norm(vector_from_rotation(pose_a[:3, :3].T @ pose_b[:3, :3])))


def _delta_covariance(last: _Known, now: _Known) -> np.ndarray:
    """(6, 6) covariance of inv(pose_last) pose_now about the axes of the last target frame.

    Both poses' errors enter as far as they are not the same: against one keyframe its noise, half
    of each registration's variance, is shared; against the last view itself there is but one
    registration; otherwise both count in full. What is the same, the error of the target frame that
    has grown since it was set, turns the axes in which the step is told. What is wrong with all
    ranges is in both poses, each in its own way.
    """
    apart = now.pose[:3, 3] - last.pose[:3, 3]
    move = np.eye(6)
    move[3:, :3] = -skew(apart)
    if now.keyframe_ns == last.stamp_ns:
        total = now.step_covariance
    elif now.keyframe_ns == last.keyframe_ns:
        total = (now.step_covariance + move @ last.step_covariance @ move.T) / 2
    else:
        total = now.covariance + move @ last.covariance @ move.T
    back = np.kron(np.eye(2), last.pose[:3, :3].T)
    covariance = back @ total @ back.T
    if now.keyframe_ns in (last.stamp_ns, last.keyframe_ns):
        delta = inverse_pose(last.pose) @ now.pose
        turned = np.kron(np.eye(2), delta[:3, :3] - np.eye(3))
        turned[3:, :3] = skew(delta[:3, 3])
        turned = turned @ back
        covariance += turned @ last.covariance @ turned.T
    by_bias = back @ (now.by_bias - move @ last.by_bias)
    covariance += np.outer(by_bias, by_bias)
    return (covariance + covariance.T) / 2
