"""A sharp limb that is where it is expected: kriged there at once."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.edge_by_edge.edges import believable
from horizon_sensor_ros.core.limb.edge_by_edge.kriged_limb import KrigedLimb, to_be_kriged
from horizon_sensor_ros.core.limb.edge_by_edge.light import at_limb, in_falling_light
from horizon_sensor_ros.core.limb.edge_by_edge.modelled import CALM_PX, of_sharpness
from horizon_sensor_ros.core.limb.edge_by_edge.points import (
    TakenEdges,
    falls_at,
    points_without_glow,
)
from horizon_sensor_ros.core.limb.profiles import ProfileGrid, scatter_px, space_mean
from horizon_sensor_ros.core.limb.sample import MIN_PROFILES, LimbSample
from horizon_sensor_ros.core.limb_points import STRETCHES, LimbPoints
from horizon_sensor_ros.core.mathematics.parts import starts_of_parts

_EXPECTED_SHARE = 0.9  # of the profiles that show an edge, the least to be as expected
_LEAST_FALL = 0.5  # of brightness at an edge, over the steepest in the profile
_LEAST_LEVEL = 0.25  # of brightness at an edge of a followed limb, over the step there


def expected_limb(sample: LimbSample, look: EdgeLook, rho_rad: float) -> LimbPoints | None:
    """Limb of a sharp edge that is where it was predicted, and all of it; None if it is not.

    Nothing is asked of the steepest fall, and edges are not placed one by one.
    """
    step, good = sample.steps
    good = at_limb(sample, step, good)
    if np.count_nonzero(good) < MIN_PROFILES or not to_be_kriged(look, step[good]):
        return None
    if sample.clipped.any():
        return None
    found = KrigedLimb(sample, look, rho_rad).about_prediction(good, followed=True)
    if found is None:
        return None
    places = found.places
    fits = at_limb(sample, places.step, believable(places))
    places, of_light = in_falling_light(sample, places, fits)
    if np.count_nonzero(fits) < max(_EXPECTED_SHARE * np.count_nonzero(good), MIN_PROFILES):
        return None
    taken = TakenEdges.of(sample, places, fits)
    jumps_px = scatter_px(taken.places.offset_px)
    if not (jumps_px < CALM_PX and _falls_there(taken.falls, sample.grid)):
        return None
    if not _lit_there(taken, sample.grid):
        return None
    shared = of_sharpness(found.shared, look).besides(of_light)
    return points_without_glow(sample, taken, shared, jumps_px, look, rho_rad, found.corner_blur)


def _falls_there(falls: np.ndarray, grid: ProfileGrid) -> bool:
    """Whether all along the limb brightness falls where the edge is predicted.

    Around a limb that lies elsewhere kriging takes what is missing for texture.
    """
    there = falls_at(falls, grid)
    return bool((there > _LEAST_FALL * falls.max(axis=1)).all())


def _lit_there(taken: TakenEdges, grid: ProfileGrid) -> bool:
    """Whether all along the limb edges lie where it is about half as bright as beside the limb.

    Kriged about a prediction that lies in space the dark below it is texture's, and the limb is
    where it was predicted.
    """
    profiles, places = taken.profiles, taken.places
    at = places.offset_px - grid.first_px
    before = at.astype(np.intp)
    share = at - before
    row = np.arange(len(at))
    level = (1.0 - share) * profiles[row, before] + share * profiles[row, before + 1]
    first = starts_of_parts(len(at), STRETCHES)
    lit = np.add.reduceat(level - space_mean(profiles), first)
    return bool((lit > _LEAST_LEVEL * np.add.reduceat(places.step, first)).all())
