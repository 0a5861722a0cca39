"""Tries of one registration: from the prior, from no turn, from all over the search, each refined
and seen how well the views agree.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import rotation_from_vector, vector_from_rotation
from horizon_sensor_ros.core.target_motion.alignment.consistency import (
    SAMPLES,
    SCORE_LOST,
    in_gaps,
    odd_share,
    view_consistency,
)
from horizon_sensor_ros.core.target_motion.alignment.matcher import Matcher
from horizon_sensor_ros.core.target_motion.alignment.pairs import Pairs
from horizon_sensor_ros.core.target_motion.alignment.refinement import (
    COARSE_STEP,
    Refined,
    mean_loss,
    refine,
)
from horizon_sensor_ros.core.target_motion.alignment.search import align_batch, rotation_starts
from horizon_sensor_ros.core.target_motion.alignment.uncertainty import (
    Uncertainty,
    uncertainty,
    worst_known,
)
from horizon_sensor_ros.core.target_motion.config import RegistrationConfig
from horizon_sensor_ros.core.target_motion.surfaces.surface_view import SurfaceView

# Scores of view consistency, 0 to 1, of clouds without odd returns.
_SURE = 0.95  # a motion with this or more is taken without a search
_LIKELY = 0.9  # with this or more the search goes no further
BEYOND_DOUBT = 0.98  # above this nothing else can be better
# Where the direction that is known worst has a sigma of more than this, over the sigma that is
# allowed, motions along it are tried.
_FIRM = 0.2
_SLIDE = 0.4  # so far to either side, rms radii of the target
# By a pixel's width each, but in no more steps than this: targets that fill a sensor of 1800 pixels
# take fewer. Ranges strewn over decades make one some 100,000 pixels long, and its motions would
# take a minute, and gigabytes.
_MOST_STEPS = 300
# Gain in score from which such a motion is taken.
_BETTER = 0.01
_CLEARER = 0.005  # where nothing else is to be said against the motion
_BESIDE_PX = np.array([-4.0, -2.0, 2.0, 4.0])  # nearer ones too, widths of a pixel on the target
_LESS = 0.95  # loss over the motion's own, below which such a nearer one is taken
# Sigma of the direction known worst, over the sigma that is allowed, from which the refinement is
# given up: it stays so wherever the motion comes to rest.
_HOPELESS = 1.5
# The same of a shift, from which it is not: pairs are lacking, which the next step or another start
# may find. Bodies of revolution hide turns only.
_LOST = 30.0
# Information on the direction known worst, in units of what is allowed: with more than this the
# sigma, which takes longer, need not be asked for.
_DOUBTFUL = 2.0
_NEAR_PRIOR_RAD = np.radians(10.0)  # a prior is good to a few degrees; farther off it is not met
_START_SPACING_RAD = np.radians(18.0)  # between starts of the search
# How far pairs may lie apart in the coarse alignments, step by step, rms radii of the target.
_SINGLE_GATES = np.array([0.3, 0.3, 0.22, 0.22, 0.15, 0.15, 0.1, 0.08])
_FIRST_GATES = np.array([0.16, 0.16, 0.12, 0.1])
_WIDE_GATES = np.array([0.3, 0.3, 0.25, 0.2, 0.15])
_SECOND_GATES = np.array([0.16, 0.12, 0.1, 0.08])


@dataclass(frozen=True, eq=False)
class Found:
    """A refined motion from view ``a`` to ``b``, and how well the views agree with it.

    searched : whether the search was needed.  expected : whether it lies near a prior.
    known : its uncertainty, where the refinement asked for it.
    """

    refined: Refined
    a: SurfaceView
    b: SurfaceView
    score: float
    overlap: float
    searched: bool
    expected: bool
    known: Uncertainty | None

    @property
    def merit(self) -> float:
        """By which tries are compared."""
        return self.score * np.sqrt(self.overlap)

    @cached_property
    def uncertainty(self) -> Uncertainty:
        """How well the motion is known."""
        return self.known or uncertainty(self.refined.pairs, self.refined.robust, self.a, self.b)

    def sound(self, config: RegistrationConfig) -> bool:
        """Whether it came to rest where every direction is observed."""
        return self.refined.converged and self.worst(config) <= 1

    def worst(self, config: RegistrationConfig) -> float:
        """How badly its worst direction is known, in units of what is allowed."""
        limits = config.max_rotation_sigma_rad, config.max_shift_sigma_m
        return worst_known(self.uncertainty.covariance, *limits)


class Finder:
    """Tries of one registration, from the cheapest start to the dearest.

    rot_b_from_a_still : (3, 3), view frame of b from that of a where nothing turned.
    """

    def __init__(
        self,
        a: SurfaceView,
        b: SurfaceView,
        config: RegistrationConfig,
        rot_b_from_a_still: np.ndarray,
    ) -> None:
        self._a, self._b, self._config, self._rot_b_from_a_still = a, b, config, rot_b_from_a_still
        self._matcher = Matcher(a, b)
        unit = 2 * b.footprint_m + 4 * np.hypot(a.sigma_m, b.sigma_m)
        self._gates = (unit, 0.4 * unit)
        self._odd = odd_share(a, b)
        # Robust weights and what they led to.
        self._asked: tuple[np.ndarray, Uncertainty] | None = None

    def find(self, prior: tuple[np.ndarray, np.ndarray] | None) -> Found:
        """The first motion that convinces, or the best of all; prior : rotation and shift."""
        a, b, config = self._a, self._b, self._config
        tried = []
        if prior is not None:
            tried.append(self._regained(self._finish(*prior, prior[0], searched=False), *prior))
            # What a good start leads to need not be better than what is accepted in the end.
            good = tried[-1].score >= config.min_score and tried[-1].refined.converged
            if good and tried[-1].expected:
                return tried[-1]
        rot_b_from_a_still = self._rot_b_from_a_still
        shift = b.image.centroid_m - rot_b_from_a_still @ a.image.centroid_m
        first = align_batch(
            a, b, rot_b_from_a_still[None], shift[None], b.size_m * _SINGLE_GATES, 250
        )
        tried.append(self._settle(first[0][0], first[1][0], searched=False))
        sure = _SURE - SCORE_LOST * self._odd
        if tried[-1].score >= sure and tried[-1].refined.converged:
            # Of a shift that is not known well enough another start may know more.
            known = tried[-1].uncertainty.covariance
            if tried[-1].sound(config) or not _lost(known, b.size_m, config, 1.0):
                return tried[-1]
        # A second candidate, and another reach, only where there is no likely answer yet.
        for reach in (_FIRST_GATES, _WIDE_GATES):
            for rotation, translation in _search(
                a, b, rot_b_from_a_still, config.search_rad, reach
            ):
                tried.append(self._settle(rotation, translation, searched=True))
                if tried[-1].score >= _LIKELY and tried[-1].sound(config):
                    return max(tried, key=lambda found: found.merit)
        return max(tried, key=lambda found: found.merit)

    def _regained(self, found: Found, rotation: np.ndarray, translation: np.ndarray) -> Found:
        """What a prior led to, or, where that lost a direction, what more reach leads to."""
        good = found.score >= self._config.min_score and found.refined.converged
        a, b = self._a, self._b
        if not (good and _lost(found.uncertainty.covariance, b.size_m, self._config)):
            return found
        start = align_batch(a, b, rotation[None], translation[None], b.size_m * _SINGLE_GATES, 250)
        again = self._finish(start[0][0], start[1][0], rotation, searched=False)
        return again if again.merit > found.merit and again.refined.converged else found

    def _finish(
        self,
        rotation: np.ndarray,
        translation: np.ndarray,
        prior_rotation: np.ndarray | None = None,
        *,
        searched: bool,
    ) -> Found:
        refined = refine(self._matcher, rotation, translation, self._gates, self._hopeless)
        expected = prior_rotation is not None and _near(refined.rotation, prior_rotation)
        score, overlap = self._agreement(refined, expected=expected)
        asked = self._asked
        known = asked[1] if asked is not None and asked[0] is refined.robust else None
        return Found(refined, self._a, self._b, score, overlap, searched, expected, known)

    def _agreement(self, refined: Refined, *, expected: bool) -> tuple[float, float]:
        """How well the views agree with a motion: score, overlap.

        An arm before the target, its shadow, or what was cropped, leaves a gap, in each view
        elsewhere on it, which says nothing against a motion that is expected.
        """
        motion = refined.rotation[None], refined.translation_m[None]
        seen = view_consistency(self._a, self._b, *motion, SAMPLES)
        if expected and not seen.score[0] >= self._config.min_score:
            seen = view_consistency(self._a, self._b, *motion, SAMPLES, spared=in_gaps)
        return float(seen.score[0]), float(seen.overlap[0])

    def _hopeless(self, information: np.ndarray, pairs: Pairs, robust: np.ndarray) -> bool:
        """Whether some direction is known so badly that no further step can mend it."""
        config = self._config
        scale = np.repeat([config.max_rotation_sigma_rad, config.max_shift_sigma_m], 3)
        if np.linalg.eigvalsh(information * np.outer(scale, scale))[0] > _DOUBTFUL:
            return False
        known = uncertainty(pairs, robust, self._a, self._b)
        self._asked = robust, known
        covariance = known.covariance
        worst = worst_known(covariance, config.max_rotation_sigma_rad, config.max_shift_sigma_m)
        return worst > _HOPELESS and not _lost(covariance, self._b.size_m, config)

    def _settle(self, rotation: np.ndarray, translation: np.ndarray, *, searched: bool) -> Found:
        """Refine; where a direction is not known well, or the views do not quite agree, look along
        the weakest direction for what agrees better.
        """
        found = self._finish(rotation, translation, searched=searched)
        sound = found.sound(self._config)
        clear = sound and found.score > BEYOND_DOUBT - SCORE_LOST * self._odd
        if clear and found.worst(self._config) < _FIRM:
            return found
        rotations, translations = _along_weakest(found, _slides_px(self._b))
        count = len(rotations) // 2
        score = view_consistency(self._a, self._b, rotations, translations, 300).score
        best = int(np.argmax(score))
        if score[best] > score[count] + (_CLEARER if clear else _BETTER):
            again = self._finish(rotations[best], translations[best], searched=searched)
            if again.score > found.score and again.sound(self._config):
                found = again
        return self._deepest(found)

    def _deepest(self, found: Found) -> Found:
        """The found motion, or one some pixels' widths beside it whose pairs lie closer together.

        Where a body is nearly one of revolution, what stands out on it comes to rest beside its
        like: the pairs found there are near, but with more reach there are others.
        """
        if not (found.sound(self._config) and found.worst(self._config) > _FIRM):
            return found
        loss = self._loss(found.refined.rotation, found.refined.translation_m)
        motions = list(zip(*_along_weakest(found, _BESIDE_PX), strict=True))
        losses = [self._loss(*motion) for motion in motions]
        best = int(np.argmin(losses))
        if losses[best] > _LESS * loss:
            return found
        again = self._finish(*motions[best], searched=found.searched)
        closer = self._loss(again.refined.rotation, again.refined.translation_m) < loss
        agrees = again.score > found.score - _BETTER and again.sound(self._config)
        return again if closer and agrees else found

    def _loss(self, rotation: np.ndarray, translation: np.ndarray) -> float:
        """Of a motion's pairs, with the reach of a start."""
        return mean_loss(self._matcher.pairs(rotation, translation, self._gates[0], COARSE_STEP))


def _near(rotation: np.ndarray, prior_rotation: np.ndarray) -> bool:
    apart = vector_from_rotation(prior_rotation.T @ rotation)
    return bool(np.linalg.norm(apart) < _NEAR_PRIOR_RAD)


def _lost(
    covariance: np.ndarray, size_m: float, config: RegistrationConfig, by: float = _LOST
) -> bool:
    """Whether what is known worst is a shift (turns count at the rms radius), worse than allowed by
    this factor.
    """
    scale = np.repeat([size_m, 1.0], 3)
    values, vectors = np.linalg.eigh(covariance * np.outer(scale, scale))
    shift = np.linalg.norm(vectors[3:, -1]) > np.linalg.norm(vectors[:3, -1])
    return bool(shift and values[-1] > (by * config.max_shift_sigma_m) ** 2)


def _slides_px(view: SurfaceView) -> np.ndarray:
    """(2 N + 1,) motions that are tried along the weakest direction, pixels' widths; none is the
    middle one.
    """
    reach = int(np.ceil(_SLIDE * view.size_m / view.footprint_m))
    step = max(1.0, reach / _MOST_STEPS)
    count = round(reach / step)
    return np.arange(-count, count + 1) * step


def _along_weakest(found: Found, steps_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Motions (C, 3, 3), (C, 3) so many pixels' widths (C,) beside the found one in the direction
    that is observed least.
    """
    b = found.b
    scale = np.array([b.size_m] * 3 + [1.0] * 3)
    vectors = np.linalg.eigh(found.uncertainty.covariance * np.outer(scale, scale))[1]
    steps = steps_px[:, None] * b.footprint_m * vectors[:, -1] / scale
    turns, centre = rotation_from_vector(steps[:, :3]), b.image.centroid_m
    rotations = turns @ found.refined.rotation
    moved = turns @ (found.refined.translation_m - centre) + centre + steps[:, 3:]
    return rotations, moved


def _search(
    a: SurfaceView,
    b: SurfaceView,
    rot_b_from_a_still: np.ndarray,
    search_rad: float,
    reach: np.ndarray,
) -> list[tuple[np.ndarray, np.ndarray]]:
    """The most consistent motions found from starts all over a ball of rotations, best first."""
    rotations = rotation_starts(search_rad, _START_SPACING_RAD) @ rot_b_from_a_still
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
