"""Whether another motion explains the views about as well, on a target that is nearly symmetric."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import vector_from_rotation
from horizon_sensor_ros.core.target_motion.alignment.attempts import BEYOND_DOUBT, Found
from horizon_sensor_ros.core.target_motion.alignment.consistency import SCORE_LOST, odd_share
from horizon_sensor_ros.core.target_motion.config import RegistrationConfig
from horizon_sensor_ros.core.target_motion.judgement.alternatives import (
    Rival,
    prism_turned,
    right_turned,
    rivals,
)
from horizon_sensor_ros.core.target_motion.judgement.hidden_patch import scores_but_for_a_patch
from horizon_sensor_ros.core.target_motion.surfaces.surface_view import SurfaceView

# Scores of two motions so near tell nothing, and so far apart much.
_SAME_SCORE, _OTHER_SCORE = 0.012, 0.03
# Rivals are aligned coarsely. Beyond the search, where a turn within it is the likelier one, those
# that are right score up to 0.056 less than a wrong motion, and wrong ones at least 0.1 less than a
# right one.
_FAR_SCORE = 0.08
# Times its own turn, up to which that of a prism by another number of sides is as likely: a target
# that hardly turned may be a prism of however many.
_AS_LIKELY = 6.0
# Where it may have turned by more, on a body whose motion was doubted, what it was like before need
# not show any more, and the right motion be no rival of the one that looks alike.
_TURNED_AWAY_RAD = np.radians(90.0)
# Turns of a prism that are asked for, over the search: it may have turned a little beyond that.
_BEYOND_SEARCH = 2.0
# Odd returns in both clouds make two scores differ by so much of their share.
_SCORE_NOISE = 0.6


@dataclass(frozen=True)
class _Margins:
    """By how much better than the motion that was found a rival must agree with the views.

    search_rad, turned_rad : what is searched for, and what the target may have turned by.  far :
        the motion found is beyond the search.  likely_rad : turns up to this are as likely as it.
    noise : what odd returns make scores differ by.
    """

    search_rad: float
    turned_rad: float
    far: bool
    likely_rad: float
    noise: float

    def of_prism(self, turn_rad: float) -> float:
        """Of a rival turned further as a prism is like itself: with a likely turn it may even agree
        a little less well, and less well still if the motion found is beyond the search; beyond
        that it has to agree better.
        """
        return self._less if turn_rad < self.likely_rad else _SAME_SCORE + self.noise

    def of_right_angles(self, turn_rad: float) -> float:
        """Of a rival turned further by right angles: the same, where the target may have turned by
        more than the search, as by then a box may have turned by a side.

        Else it has to agree better, and clearly so if its turn is beyond twice the search. But if
        the motion found is itself beyond the search, a rival with a likely turn may even agree a
        little less well, and any other one need only agree better at all.
        """
        if self.turned_rad > self.search_rad and turn_rad < self.likely_rad:
            return self._less
        likely = turn_rad < 2 * self.search_rad
        margin = (_SAME_SCORE if likely else _OTHER_SCORE) + self.noise
        if self.far:
            return -margin if likely else 0.0
        return margin

    @property
    def _less(self) -> float:
        # Turns as likely as its own speak against it and need not be better.
        return -(_FAR_SCORE if self.far else _OTHER_SCORE)


def ambiguity(
    found: Found,
    a: SurfaceView,
    b: SurfaceView,
    rot_b_from_a_still: np.ndarray,
    config: RegistrationConfig,
    turned_rad: float,
    doubted: bool,
) -> str:
    """Why a motion nobody expected may be another one, on a target that is nearly symmetric: "" if
    nothing says so.

    rot_b_from_a_still : as of `Finder`. turned_rad, doubted : as of `register`, the former not
    below the search.
    Rivals are the same motion turned further, about the target's axes, with which the views agree
    about as well. How much better a rival must agree (`_Margins`) depends on how likely its turn
    is: up to `_AS_LIKELY` times the turn that was found, within what the target may have turned.
    Where views between these two were doubted a rival may be as likely whatever was found: a prism
    that was seen to turn, and then not to, has turned by a side. Beyond `_TURNED_AWAY_RAD` no
    motion is believed then.
    Right angles are not asked for of a motion within the search with which the views agree beyond
    doubt; one beyond the search with which they do not is refused without asking.
    A motion within the search, of a target that may have turned by no more than that, is believed
    in spite of rivals without a likely turn if the views agree beyond doubt, and with no rival
    better, once something may have hidden a patch of each.
    """
    if doubted and turned_rad > _TURNED_AWAY_RAD:
        return (
            f"may have turned by up to {np.degrees(turned_rad):.0f} deg since motions that look"
            " alike could not be told apart"
        )
    rotation, translation = found.refined.rotation, found.refined.translation_m
    turn = float(np.linalg.norm(vector_from_rotation(rotation @ rot_b_from_a_still.T)))
    far = turn > config.search_rad
    within = not far and turned_rad <= config.search_rad
    odd = odd_share(a, b)
    clear = found.score > BEYOND_DOUBT - SCORE_LOST * odd
    likely_rad = turned_rad if doubted else min(_AS_LIKELY * turn, turned_rad)
    margins = _Margins(config.search_rad, turned_rad, far, likely_rad, _SCORE_NOISE * odd)
    most_rad = max(_BEYOND_SEARCH * config.search_rad, turned_rad)
    starts = prism_turned(b, rotation, translation, rot_b_from_a_still, min(most_rad, np.pi))
    prisms = rivals(a, b, rotation, translation, rot_b_from_a_still, starts)
    doubt = _better(prisms, margins.of_prism)
    if doubt and doubt.turn_rad < likely_rad:
        return _tell_rival(doubt, found)
    if not doubt:
        if clear and within:
            return ""
        if far and not clear:
            return (
                f"a turn by {np.degrees(turn):.0f} deg, beyond the search, with which the views"
                f" agree to {found.score:.3f} only"
            )
    boxes = rivals(a, b, rotation, translation, rot_b_from_a_still, right_turned(a, b, rotation))
    doubt = doubt or _better(boxes, margins.of_right_angles)
    if not doubt or (within and not doubted and _best_but_for_a_patch(found, a, b, prisms + boxes)):
        return ""
    return _tell_rival(doubt, found)


def _better(asked: Sequence[Rival], margin: Callable[[float], float]) -> Rival | None:
    """Of the rivals that agree better by their margin the one that turns least; None if none
    does.
    """
    better = (rival for rival in asked if rival.lead > margin(rival.turn_rad))
    return min(better, key=lambda rival: rival.turn_rad, default=None)


def _best_but_for_a_patch(
    found: Found, a: SurfaceView, b: SurfaceView, asked: Sequence[Rival]
) -> bool:
    """Whether views of which a patch may be hidden agree with a motion beyond doubt, and with none
    of its rivals better.
    """
    rotations = np.array([found.refined.rotation, *(rival.rotation for rival in asked)])
    shifts_m = np.array([found.refined.translation_m, *(rival.translation_m for rival in asked)])
    own, *others = scores_but_for_a_patch(a, b, rotations, shifts_m).tolist()
    return own > BEYOND_DOUBT and own >= max(others)


def _tell_rival(rival: Rival, found: Found) -> str:
    """The other motion in words."""
    return (
        f"views agree to {found.score:.3f} over {found.overlap:.2f} of the points, and"
        f" turned by {np.degrees(rival.apart_rad):.0f} deg to {rival.score:.3f} over"
        f" {rival.overlap:.2f}"
    )
