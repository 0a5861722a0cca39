"""Motion of a target of unknown shape between two point clouds: search, refinement, judgement."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target.alternatives import rivals
from horizon_sensor_ros.core.target.config import RegistrationConfig
from horizon_sensor_ros.core.target.consistency import view_consistency
from horizon_sensor_ros.core.target.judgement import Uncertainty, uncertainty, weak_directions
from horizon_sensor_ros.core.target.range_image import RangeImage, range_image
from horizon_sensor_ros.core.target.refinement import Matcher, Refined, refine
from horizon_sensor_ros.core.target.rigid import (
    pose_matrix,
    rotation_from_vector,
    skew,
    vector_from_rotation,
)
from horizon_sensor_ros.core.target.search import align_batch, rotation_starts
from horizon_sensor_ros.core.target.surfels import SurfaceView, surface_view

# View consistency, of clouds without odd returns, from which a motion is taken without a search.
_SURE = 0.95
# And one from which the search goes no further.
_LIKELY = 0.9
# And one beyond which nothing else can be better.
_BEYOND_DOUBT = 0.98
# Scores of two motions so near tell nothing, and so far apart much.
_SAME_SCORE, _OTHER_SCORE = 0.012, 0.03
# Of the share of odd returns in both clouds so much is missing from the score of the true motion,
# and makes two scores differ.
_SCORE_LOST, _SCORE_NOISE = 0.6, 0.6
# Reach, in rms radii of the target, of the look along a direction that is not observed, and the
# gain that counts.
_SLIDE = 0.4
_BETTER = 0.01
# Starts of the search lie so far apart.
_START_SPACING_RAD = np.radians(18.0)
# Reach of the coarse alignments, step by step, in rms radii of the target.
_SINGLE_GATES = np.array([0.3, 0.3, 0.22, 0.22, 0.15, 0.15, 0.1, 0.08])
_FIRST_GATES = np.array([0.16, 0.16, 0.12, 0.1])
_WIDE_GATES = np.array([0.3, 0.3, 0.25, 0.2, 0.15])
_SECOND_GATES = np.array([0.16, 0.12, 0.1, 0.08])


@dataclass(frozen=True, eq=False)
class TargetView:
    """A cloud made ready for registration; ``surface`` is None where ``status`` is not OK."""

    status: Status
    reason: str
    image: RangeImage
    surface: SurfaceView | None


def _nan(*shape: int) -> np.ndarray:
    return np.full(shape, np.nan)


@dataclass(frozen=True, eq=False)
class Registration:
    """Motion of the target from cloud a to cloud b, in the sensor's frame: p_b = pose_b_from_a p_a.

    covariance : (6, 6) of (rotation vector, shift of the target's point at ``centre_m``), rad and
        m, about the sensor's fixed axes: the true motion is the found one followed by that small
        one.
    score, overlap : view consistency.  weak : (K, 6) directions worse known than allowed, in the
        order of ``covariance``.
    num_points : pairs used.  searched : whether the search was needed.
    Everything numeric is NaN where there was nothing to tell; pose and covariance are NaN unless
    the status is OK.
    """

    status: Status
    reason: str
    pose_b_from_a: np.ndarray = field(default_factory=lambda: _nan(4, 4))
    covariance: np.ndarray = field(default_factory=lambda: _nan(6, 6))
    centre_m: np.ndarray = field(default_factory=lambda: _nan(3))
    score: float = float("nan")
    overlap: float = float("nan")
    rms_residual_m: float = float("nan")
    num_points: int = 0
    weak: np.ndarray = field(default_factory=lambda: np.empty((0, 6)))
    searched: bool = False

    def covariance_at(self, point_m: np.ndarray) -> np.ndarray:
        """(6, 6) covariance with the shift taken at another point of the sensor's frame."""
        move = np.eye(6)
        move[3:, :3] = -skew(np.asarray(point_m, float) - self.centre_m)
        return move @ self.covariance @ move.T


def target_view(points: np.ndarray, config: RegistrationConfig | None = None) -> TargetView:
    """Prepare a cloud, (H, W, 3) organised or (N, 3) plain, metres; bad data comes back as a
    status."""
    config = RegistrationConfig() if config is None else config
    image = range_image(points, config.focal_px, config.min_points)
    if image.status is not Status.OK:
        return TargetView(image.status, image.reason, image, None)
    surface = surface_view(image, config.range_noise_m)
    if len(surface.surfels.points) < config.min_points // 4:
        reason = f"{len(surface.surfels.points)} surface elements, {config.min_points // 4} needed"
        return TargetView(Status.TOO_FEW_POINTS, reason, image, None)
    return TargetView(Status.OK, "", image, surface)


def register(
    a: TargetView,
    b: TargetView,
    config: RegistrationConfig | None = None,
    prior_b_from_a: np.ndarray | None = None,
) -> Registration:
    """Find the target's motion between two views.

    prior_b_from_a : (4, 4) expected motion, good to a few degrees and centimetres; the search
        follows only where it does not hold. Without one, a start from no turn is tried before the
        search.
    Bad data never raises: status and reason tell (TOO_FEW_POINTS, NOT_CONVERGED, ILL_CONDITIONED
    where a direction cannot be observed, POOR_FIT where the views contradict each other). Raises
    ValueError for a prior of another shape.
    """
    config = RegistrationConfig() if config is None else config
    if prior_b_from_a is not None and np.shape(prior_b_from_a) != (4, 4):
        raise ValueError(f"prior_b_from_a must be (4, 4); got {np.shape(prior_b_from_a)}")
    for view in (a, b):
        if view.surface is None:
            return Registration(view.status, view.reason)
    assert a.surface is not None
    assert b.surface is not None
    prior = None
    if prior_b_from_a is not None:
        turn_a, turn_b = a.image.rot_sensor_from_view, b.image.rot_sensor_from_view
        prior = (turn_b.T @ prior_b_from_a[:3, :3] @ turn_a, turn_b.T @ prior_b_from_a[:3, 3])
    found = _Finder(a.surface, b.surface, config).find(prior)
    return _judge(found, a, b, config)


@dataclass(frozen=True, eq=False)
class _Found:
    refined: Refined
    b: SurfaceView
    score: float
    overlap: float
    searched: bool
    expected: bool

    @property
    def merit(self) -> float:
        return self.score * np.sqrt(self.overlap)

    @cached_property
    def uncertainty(self) -> Uncertainty:
        return uncertainty(self.refined, self.b)

    def sound(self, config: RegistrationConfig) -> bool:
        """Whether it came to rest where every direction is observed."""
        limits = config.max_rotation_std_rad, config.max_shift_std_m
        return self.refined.converged and not len(
            weak_directions(self.uncertainty.covariance, *limits)
        )


class _Finder:
    """Tries of one registration, from the cheapest start to the dearest."""

    def __init__(self, a: SurfaceView, b: SurfaceView, config: RegistrationConfig) -> None:
        self._a, self._b, self._config = a, b, config
        self._matcher = Matcher(a, b)
        unit = 2 * b.footprint_m + 4 * np.hypot(a.sigma_m, b.sigma_m)
        self._gates = (unit, 0.6 * unit, 0.4 * unit)
        self._odd = _odd_share(a, b)

    def find(self, prior: tuple[np.ndarray, np.ndarray] | None) -> _Found:
        a, b, config = self._a, self._b, self._config
        tried = []
        if prior is not None:
            tried.append(self._finish(*prior, False, True))
            # What a good start leads to need not be better than what is accepted in the end.
            if tried[-1].score >= config.min_score and tried[-1].refined.converged:
                return tried[-1]
        shift = b.image.centroid_m - a.image.centroid_m
        first = align_batch(a, b, np.eye(3)[None], shift[None], b.size_m * _SINGLE_GATES, 250)
        tried.append(self._settle(first[0][0], first[1][0], False))
        sure = _SURE - _SCORE_LOST * self._odd
        if tried[-1].score >= sure and tried[-1].refined.converged:
            return tried[-1]
        # A second candidate, and another reach, only where there is no likely answer yet.
        for reach in (_FIRST_GATES, _WIDE_GATES):
            for rotation, translation in _search(a, b, config.search_rad, reach):
                tried.append(self._settle(rotation, translation, True))
                if tried[-1].score >= _LIKELY and tried[-1].sound(config):
                    return max(tried, key=lambda found: found.merit)
        return max(tried, key=lambda found: found.merit)

    def _finish(
        self,
        rotation: np.ndarray,
        translation: np.ndarray,
        searched: bool,
        expected: bool = False,
    ) -> _Found:
        refined = refine(self._matcher, rotation, translation, self._gates)
        seen = view_consistency(
            self._a, self._b, refined.rotation[None], refined.translation_m[None], 600
        )
        score, overlap = float(seen.score[0]), float(seen.overlap[0])
        return _Found(refined, self._b, score, overlap, searched, expected)

    def _settle(self, rotation: np.ndarray, translation: np.ndarray, searched: bool) -> _Found:
        """Refine; where a direction is not observed, or the views do not quite agree, look along
        the weakest direction for what agrees better."""
        found = self._finish(rotation, translation, searched)
        clear = found.score > _BEYOND_DOUBT - _SCORE_LOST * self._odd
        if clear and found.sound(self._config):
            return found
        rotations, translations = _along_weakest(found, self._b)
        seen = view_consistency(self._a, self._b, rotations, translations, 300)
        merit = seen.score * np.sqrt(seen.overlap)
        best = int(np.argmax(merit))
        if merit[best] < merit[len(merit) // 2] + _BETTER:
            return found
        again = self._finish(rotations[best], translations[best], searched)
        return max(found, again, key=lambda one: one.merit)


def _odd_share(a: SurfaceView, b: SurfaceView) -> float:
    """Share of both clouds' points that share their surface with no other."""
    return 1 - (a.image.num_used / a.image.num_points + b.image.num_used / b.image.num_points) / 2


def _along_weakest(found: _Found, b: SurfaceView) -> tuple[np.ndarray, np.ndarray]:
    """Motions (C, 3, 3), (C, 3) to both sides of the found one (the middle one) in the direction
    that is observed least, in steps of a pixel's width."""
    scale = np.array([b.size_m] * 3 + [1.0] * 3)
    vectors = np.linalg.eigh(found.uncertainty.covariance * np.outer(scale, scale))[1]
    count = int(np.ceil(_SLIDE * b.size_m / b.footprint_m))
    steps = np.arange(-count, count + 1)[:, None] * b.footprint_m * vectors[:, -1] / scale
    turns, centre = rotation_from_vector(steps[:, :3]), b.image.centroid_m
    rotations = turns @ found.refined.rotation
    moved = turns @ (found.refined.translation_m - centre) + centre + steps[:, 3:]
    return rotations, moved


def _search(
    a: SurfaceView, b: SurfaceView, search_rad: float, reach: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """The most consistent motions found from starts all over a ball of rotations, best first."""
    rotations = rotation_starts(search_rad, _START_SPACING_RAD)
    translations = b.image.centroid_m - rotations @ a.image.centroid_m
    for gates, align_samples, view_samples, kept in (
        (reach, 150, 200, 8),
        (_SECOND_GATES, 250, 400, 2),
    ):
        rotations, translations = align_batch(
            a, b, rotations, translations, b.size_m * gates, align_samples
        )
        seen = view_consistency(a, b, rotations, translations, view_samples, 1.0)
        best = np.argsort(-seen.score * np.sqrt(seen.overlap), kind="stable")[:kept]
        rotations, translations = rotations[best], translations[best]
    return list(zip(rotations, translations, strict=True))


def _judge(found: _Found, a: TargetView, b: TargetView, config: RegistrationConfig) -> Registration:
    assert a.surface is not None
    assert b.surface is not None
    refined = found.refined
    known = Registration(
        Status.OK, "", score=found.score, overlap=found.overlap,
        num_points=len(refined.pairs.point_a), searched=found.searched,
    )  # fmt: skip
    least = config.min_score - _SCORE_LOST * _odd_share(a.surface, b.surface)
    if found.score < least or found.overlap < config.min_overlap:
        reason = f"views agree to {found.score:.3f} over {found.overlap:.2f} of the points"
        return replace(known, status=Status.POOR_FIT, reason=reason)
    turn_a, turn_b = a.image.rot_sensor_from_view, b.image.rot_sensor_from_view
    both = np.kron(np.eye(2), turn_b)
    judged = found.uncertainty
    covariance = both @ judged.covariance @ both.T
    known = replace(known, rms_residual_m=judged.rms_residual_m)
    weak = weak_directions(covariance, config.max_rotation_std_rad, config.max_shift_std_m)
    if len(weak):
        reason = _tell(weak[0], covariance)
        return replace(known, status=Status.ILL_CONDITIONED, reason=reason, weak=weak)
    if not refined.converged:
        reason = f"still moving after {refined.iterations} iterations"
        return replace(known, status=Status.NOT_CONVERGED, reason=reason)
    doubt = "" if found.expected else _doubt(found, a.surface, b.surface, config)
    if doubt:
        return replace(known, status=Status.POOR_FIT, reason=doubt)
    pose = pose_matrix(turn_b @ refined.rotation @ turn_a.T, turn_b @ refined.translation_m)
    return replace(
        known, pose_b_from_a=pose, covariance=covariance, centre_m=turn_b @ judged.centre_m
    )


def _doubt(found: _Found, a: SurfaceView, b: SurfaceView, config: RegistrationConfig) -> str:
    """Why a motion nobody expected may be another one on a target that is nearly symmetric; ""
    where it is not.

    A rival must be the better one, by more where it is turned beyond what is likely; where the
    motion itself is beyond the turns that are searched, it is enough to be as good, or better at
    all.
    """
    turn = float(np.linalg.norm(vector_from_rotation(found.refined.rotation)))
    far = turn > config.search_rad
    odd = _odd_share(a, b)
    clear = found.score > _BEYOND_DOUBT - _SCORE_LOST * odd
    if clear and not far:
        return ""
    if far and not clear:
        return (
            f"a turn by {np.degrees(turn):.0f} deg, beyond the search, with which the views agree"
            f" to {found.score:.3f} only"
        )
    for rival in rivals(a, b, found.refined.rotation, found.refined.translation_m):
        likely = rival.turn_rad < 2 * config.search_rad
        margin = (_SAME_SCORE if likely else _OTHER_SCORE) + _SCORE_NOISE * odd
        if far:
            margin = -margin if likely else 0.0
        if rival.lead > margin:
            return (
                f"views agree to {found.score:.3f} over {found.overlap:.2f} of the points, and"
                f" turned by {np.degrees(rival.apart_rad):.0f} deg to {rival.score:.3f} over"
                f" {rival.overlap:.2f}"
            )
    return ""


def _tell(weak: np.ndarray, covariance: np.ndarray) -> str:
    """The worst direction in words."""
    turn, shift = weak[:3], weak[3:]
    if np.linalg.norm(turn) > np.linalg.norm(shift):
        axis = turn / np.linalg.norm(turn)
        std = f"{min(np.degrees(np.sqrt(axis @ covariance[:3, :3] @ axis)), 180.0):.2f} deg"
        what = "a turn about"
    else:
        axis = shift / np.linalg.norm(shift)
        std = f"{min(1e3 * np.sqrt(axis @ covariance[3:, 3:] @ axis), 9999.0):.1f} mm"
        what = "a shift along"
    return f"{what} ({axis[0]:.2f}, {axis[1]:.2f}, {axis[2]:.2f}) is not observed: std {std}"
