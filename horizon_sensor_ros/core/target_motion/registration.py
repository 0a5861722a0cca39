"""Motion of the target between two clouds, or why none is to be believed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import (
    pose_matrix,
    rotated_covariance,
    skew,
    turn_and_shift,
)
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.alignment.attempts import Finder, Found
from horizon_sensor_ros.core.target_motion.alignment.consistency import (
    SAMPLES,
    SCORE_LOST,
    odd_share,
    view_consistency,
)
from horizon_sensor_ros.core.target_motion.alignment.relief import range_error_of_relief_m
from horizon_sensor_ros.core.target_motion.alignment.uncertainty import weak_directions
from horizon_sensor_ros.core.target_motion.config import RegistrationConfig
from horizon_sensor_ros.core.target_motion.judgement.ambiguity import ambiguity
from horizon_sensor_ros.core.target_motion.judgement.layers import Layer, layer_off
from horizon_sensor_ros.core.target_motion.judgement.one_body import part_off_m
from horizon_sensor_ros.core.target_motion.surfaces.surface_view import SurfaceView
from horizon_sensor_ros.core.target_motion.target_view import TargetView

_FARTHEST_M = 500.0  # that a sensor sees a target


def _nan(*shape: int) -> np.ndarray:
    return np.full(shape, np.nan)


@dataclass(frozen=True, eq=False)
class Registration:
    """Motion of the target from cloud a to cloud b, in the sensor's frame: p_b = pose_b_from_a p_a.

    covariance : (6, 6) of (rotation vector, shift of the target's point at ``centre_m``), rad and
        m, about the sensor's fixed axes: the true motion is the found one followed by that small
        one.  by_bias : (6,) the part of it, one sigma, that comes from `range_bias_sigma_m`: of all
        motions by one sensor at once.
    score, overlap : view consistency.  weak : (K, 6) directions worse known than allowed, in the
        order of ``covariance``.
    num_points : pairs used.  searched : whether the search was needed.
    part_off_m : by which a part of the cloud moved otherwise; NaN where all of it is one body.
    doubted : it was refused since another motion explains the views about as well.
    Everything numeric is NaN where there was nothing to tell; pose and covariance are NaN unless
    the status is OK.
    """

    status: Status
    reason: str
    pose_b_from_a: np.ndarray = field(default_factory=lambda: _nan(4, 4))
    covariance: np.ndarray = field(default_factory=lambda: _nan(6, 6))
    by_bias: np.ndarray = field(default_factory=lambda: _nan(6))
    centre_m: np.ndarray = field(default_factory=lambda: _nan(3))
    score: float = float("nan")
    overlap: float = float("nan")
    rms_residual_m: float = float("nan")
    num_points: int = 0
    weak: np.ndarray = field(default_factory=lambda: np.empty((0, 6)))
    searched: bool = False
    part_off_m: float = float("nan")
    doubted: bool = False

    def refused(self, status: Status, reason: str) -> Registration:
        """Return how well the views agree, without the motion, and why there is none."""
        return Registration(
            status, reason, score=self.score, overlap=self.overlap,
            rms_residual_m=self.rms_residual_m, num_points=self.num_points, searched=self.searched,
        )  # fmt: skip

    def covariance_at(self, point_m: np.ndarray) -> np.ndarray:
        """(6, 6) covariance with the shift taken at another point of the sensor's frame."""
        move = self._to(point_m)
        return move @ self.covariance @ move.T

    def by_bias_at(self, point_m: np.ndarray) -> np.ndarray:
        """(6,) ``by_bias`` with the shift taken at another point of the sensor's frame."""
        return self._to(point_m) @ self.by_bias

    def _to(self, point_m: np.ndarray) -> np.ndarray:
        move = np.eye(6)
        move[3:, :3] = -skew(np.asarray(point_m, float) - self.centre_m)
        return move


def register(
    a: TargetView,
    b: TargetView,
    config: RegistrationConfig | None = None,
    prior_b_from_a: np.ndarray | None = None,
    *,
    turned_rad: float = 0.0,
    doubted: bool = False,
) -> Registration:
    """Find the target's motion between two views.

    prior_b_from_a : (4, 4) expected motion, good to a few degrees and centimetres; the search
        follows only where it does not hold. Without one, a start from no turn is tried before the
        search.
    turned_rad : how far the target may have turned since view a, where that is more than the search
        covers: views in between were refused. doubted : whether the motion to one of those could
        not be told from another that looks alike.
    Bad data never raises: status and reason tell (TOO_FEW_POINTS, NOT_CONVERGED, ILL_CONDITIONED
    where a direction cannot be observed, POOR_FIT where the views contradict each other). Raises
    ValueError for a prior of another shape, or not finite.
    """
    config = RegistrationConfig() if config is None else config
    if prior_b_from_a is not None:
        prior_b_from_a = np.asarray(prior_b_from_a, dtype=float)
        if prior_b_from_a.shape != (4, 4):
            raise ValueError(f"prior_b_from_a must be (4, 4), got {prior_b_from_a.shape}")
        if not np.isfinite(prior_b_from_a).all():
            raise ValueError(f"prior_b_from_a must be finite, got {prior_b_from_a.tolist()}")
    for view in (a, b):
        if view.surface is None:
            return Registration(view.status, view.reason)
    assert a.surface is not None
    assert b.surface is not None
    prior = None if prior_b_from_a is None else _in_views(prior_b_from_a, a, b)
    rot_b_from_a_still = b.image.rot_sensor_from_view.T @ a.image.rot_sensor_from_view
    found = Finder(a.surface, b.surface, config, rot_b_from_a_still).find(prior)
    return _judge(
        found, a, b, rot_b_from_a_still, config, max(turned_rad, config.search_rad), doubted
    )


def contradiction(
    a: TargetView, b: TargetView, pose_b_from_a: np.ndarray, config: RegistrationConfig
) -> Registration | None:
    """Hold a motion that was not found between these two views against them: a refusal where they
    contradict each other or a part of them is off, else None.

    pose_b_from_a : (4, 4) the motion, p_b = pose p_a in the sensor's frame. Both views have
        surfaces.
    """
    assert a.surface is not None
    assert b.surface is not None
    rotation, shift = _in_views(pose_b_from_a, a, b)
    seen = view_consistency(a.surface, b.surface, rotation[None], shift[None], SAMPLES)
    known = Registration(
        Status.POOR_FIT, "", score=float(seen.score[0]), overlap=float(seen.overlap[0])
    )
    if known.score < _least_score(a.surface, b.surface, config):
        reason = f"a view kept from before agrees to {known.score:.3f} only"
        return replace(known, reason=reason)
    off_m = part_off_m(a.surface, b.surface, rotation, shift)
    if off_m is not None:
        reason = f"{_tell_part(off_m)} (by a view kept from before)"
        return replace(known, reason=reason, part_off_m=off_m)
    return None


def _in_views(
    pose_b_from_a: np.ndarray, a: TargetView, b: TargetView
) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and shift (3,) of a motion in the clouds' frames, from a's view frame to
    b's.
    """
    turn_a, turn_b = a.image.rot_sensor_from_view, b.image.rot_sensor_from_view
    rotation, shift_m = pose_b_from_a[:3, :3], pose_b_from_a[:3, 3]
    shift_m = shift_m + (rotation @ a.image.sensor_m - b.image.sensor_m)
    return turn_b.T @ rotation @ turn_a, turn_b.T @ shift_m


def _least_score(a: SurfaceView, b: SurfaceView, config: RegistrationConfig) -> float:
    return config.min_score - SCORE_LOST * odd_share(a, b)


def _tell_part(off_m: float) -> str:
    return (
        f"a part of the cloud is off by {1e3 * off_m:.0f} mm: it moves otherwise, or ranges are"
        " biased; is there more than the target in the cloud?"
    )


def _tell_layer(layer: Layer) -> str:
    which = "nearer" if layer.nearer else "farther"
    return (
        f"what is {which} than {layer.depth_m:.2f} m moved otherwise than the rest, by"
        f" {1e3 * layer.off_m:.1f} mm; is there more than the target in the cloud?"
    )


def _judge(
    found: Found,
    a: TargetView,
    b: TargetView,
    rot_b_from_a_still: np.ndarray,
    config: RegistrationConfig,
    turned_rad: float,
    doubted: bool,
) -> Registration:
    assert a.surface is not None
    assert b.surface is not None
    refined = found.refined
    known = Registration(
        Status.OK, "", score=found.score, overlap=found.overlap,
        num_points=len(refined.pairs.kind), searched=found.searched,
    )  # fmt: skip
    least = _least_score(a.surface, b.surface, config)
    if found.score < least or found.overlap < config.min_overlap:
        reason = f"views agree to {found.score:.3f} over {found.overlap:.2f} of the points"
        return replace(known, status=Status.POOR_FIT, reason=reason)
    turn_a, turn_b = a.image.rot_sensor_from_view, b.image.rot_sensor_from_view
    judged = found.uncertainty
    covariance, by_bias = _covariance(found, a.surface, b.surface, turn_b, config)
    known = replace(known, rms_residual_m=judged.rms_residual_m)
    weak = weak_directions(covariance, config.max_rotation_sigma_rad, config.max_shift_sigma_m)
    if len(weak):
        reason = _tell(weak[0], covariance) + _units(b.image.centroid_m[2])
        return replace(known, status=Status.ILL_CONDITIONED, reason=reason, weak=weak)
    if not refined.converged:
        reason = f"still moving after {refined.iterations} iterations"
        return replace(known, status=Status.NOT_CONVERGED, reason=reason)
    off_m = part_off_m(a.surface, b.surface, refined.rotation, refined.translation_m)
    if off_m is not None:
        return replace(known, status=Status.POOR_FIT, reason=_tell_part(off_m), part_off_m=off_m)
    layer = layer_off(refined.pairs, refined.robust, a.surface, b.surface)
    if layer is not None:
        reason = _tell_layer(layer)
        return replace(known, status=Status.POOR_FIT, reason=reason, part_off_m=layer.off_m)
    doubt = ""
    if not found.expected:
        doubt = ambiguity(
            found, a.surface, b.surface, rot_b_from_a_still, config, turned_rad, doubted
        )
    if doubt:
        return replace(known, status=Status.POOR_FIT, reason=doubt, doubted=True)
    rotation = turn_b @ refined.rotation @ turn_a.T
    shift_m = turn_b @ refined.translation_m + (b.image.sensor_m - rotation @ a.image.sensor_m)
    pose = pose_matrix(rotation, shift_m)
    return replace(
        known,
        pose_b_from_a=pose,
        covariance=covariance,
        by_bias=by_bias,
        centre_m=turn_b @ judged.centre_m + b.image.sensor_m,
    )


def _covariance(
    found: Found,
    a: SurfaceView,
    b: SurfaceView,
    rot_sensor_from_b: np.ndarray,
    config: RegistrationConfig,
) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (6, 6) in the sensor's axes, and (6,) what a common bias of ranges adds to it."""
    refined, judged = found.refined, found.uncertainty
    by_range = turn_and_shift(rot_sensor_from_b) @ judged.by_range
    by_bias = config.range_bias_sigma_m * by_range
    relief_m = range_error_of_relief_m(a, b, refined.rotation, refined.translation_m)
    covariance = rotated_covariance(judged.covariance, rot_sensor_from_b)
    covariance += np.outer(by_bias, by_bias) + relief_m**2 * np.outer(by_range, by_range)
    return covariance, by_bias


def _units(distance_m: float) -> str:
    """A doubt about the units of a cloud that is farther away than sensors of targets see."""
    if distance_m < _FARTHEST_M:
        return ""
    return f"; the cloud is {distance_m:.0f} m away: are its points in millimetres?"


def _tell(weak: np.ndarray, covariance: np.ndarray) -> str:
    """The worst direction in words."""
    turn, shift = weak[:3], weak[3:]
    if np.linalg.norm(turn) > np.linalg.norm(shift):
        axis = turn / np.linalg.norm(turn)
        sigma = f"{min(np.degrees(np.sqrt(axis @ covariance[:3, :3] @ axis)), 180.0):.2f} deg"
        what = "a turn about"
    else:
        axis = shift / np.linalg.norm(shift)
        sigma = f"{min(1e3 * np.sqrt(axis @ covariance[3:, 3:] @ axis), 9999.0):.1f} mm"
        what = "a shift along"
    return f"{what} ({axis[0]:.2f}, {axis[1]:.2f}, {axis[2]:.2f}) is not observed: sigma {sigma}"
