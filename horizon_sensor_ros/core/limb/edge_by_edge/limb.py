"""The limb of edges that were found one by one, and what they are off by together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb.air import usual_length_px
from horizon_sensor_ros.core.limb.edge.looks import guess_looks
from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.edge_by_edge.edges import LimbEdges, believable
from horizon_sensor_ros.core.limb.edge_by_edge.light import in_falling_light, lit_edges
from horizon_sensor_ros.core.limb.edge_by_edge.points import (
    TakenEdges,
    points_in_glow,
    points_without_glow,
)
from horizon_sensor_ros.core.limb.glow.contour import ContourLimb, contour_limb
from horizon_sensor_ros.core.limb.profiles import EdgePlaces, pixel_rad_across, scatter_px
from horizon_sensor_ros.core.limb.sample import MIN_PROFILES, LimbSample, RefinePass
from horizon_sensor_ros.core.limb_points import STRETCHES, LimbPoints, SharedError
from horizon_sensor_ros.core.mathematics.robust import medians
from horizon_sensor_ros.core.status import Status

_LONGEST_CONTOUR_PX = 4.0  # over which glow fades: longer, and a profile's end is not yet space
# Error that neighbours share, by whether air glows and whether edges were placed without a model:
# the scatter, beyond noise, of whole stretches of simulated limbs about the true ones.
_COHERENT_PX = {
    (False, True): 0.1,
    (True, False): 0.2,
    (True, True): 0.4,
}
_MOVED_SHARE = 0.75  # of what a model moves stretches by unequally, as measured beside truth
# Longer glow goes with ground that is seen finer: length from where on that error grows with it,
# and by how much at most, as measured in the same way.
_FINE_PX, _FINEST = 2.0, 2.5
# Where glow changes too fast along a limb to be fitted with it its contour is no more of a limb:
# errors of simulated ones towards the terminator and beside the Sun, over the other limbs'.
_UNEVEN_GLOW = 1.5
# Errors of a camera's whole limb and of its ends, over that of its stretches, where air glows or no
# model fits.
_SHIFT, _SLOPE = 1.5, 0.7


def limb_of_edges(
    sample: LimbSample,
    edges: LimbEdges,
    steepest: EdgePlaces,
    looks: Sequence[EdgeLook],
    view: CameraView,
    rho_rad: float,
    step: RefinePass,
    *,
    uneven: bool,
) -> tuple[LimbPoints, tuple[EdgeLook, ...]]:
    """Limb of edges found one by one, and looks as `refine_limb` returns them.

    steepest : where brightness falls most steeply. uneven : glow is known to change fast along it.
    """
    given = bool(looks)
    places, good, of_clipping = lit_edges(sample, edges, looks)
    places, of_light = in_falling_light(sample, places, good)
    if np.count_nonzero(good) < MIN_PROFILES:
        reason = f"{np.count_nonzero(good)} of {len(good)} profiles across the limb show an edge"
        return LimbPoints.none(Status.NO_LIMB, reason), ()
    jumps_px = scatter_px(steepest.offset_px[good])
    taken = TakenEdges.of(sample, places, good)
    if step.guess and not given:
        looks = guess_looks(taken.profiles, sample.grid.d_px, taken.places)
    glow_px = max((look.glow_px for look in looks), default=0.0)
    glows = glow_px > 0.0
    shared = edges.shared
    if glows or edges.model_free:
        moved_px = None
        if not edges.model_free:
            moved_px = (places.offset_px - steepest.offset_px)[good & believable(steepest)]
        length_px = usual_length_px(view, rho_rad, step.factor)
        coherent = _coherent_px(taken.places, glow_px, length_px, moved_px)
        if step.contour and 0.0 < glow_px <= _LONGEST_CONTOUR_PX:
            # Edges without a model lie the farther out, the darker the ground.
            shared_px = coherent if edges.model_free else None
            contour = _contour(sample, good, taken, view, shared_px)
            if contour is not None:
                coherent = contour.coherent_px
                taken = taken.along(contour)
        if uneven:
            coherent *= _UNEVEN_GLOW
        shared = SharedError(coherent, _SHIFT * coherent, _SLOPE * coherent)
    shared = shared.besides(of_clipping).besides(of_light)
    no_model = given and edges.model_free
    if glows:
        points = points_in_glow(sample, taken, shared, jumps_px, view, rho_rad)
    else:
        look = None if edges.model_free else looks[0]
        points = points_without_glow(
            sample, taken, shared, jumps_px, look, rho_rad, edges.corner_blur
        )
        if no_model:
            points = replace(points, modelled=False)
    return points, () if no_model else tuple(looks)


def _contour(
    sample: LimbSample,
    good: np.ndarray,
    taken: TakenEdges,
    view: CameraView,
    shared_px: float | None,
) -> ContourLimb | None:
    """Contour of the glow above the edges that were taken; good : (M,) which of the sample's.

    shared_px : as of `contour_limb`, by default if None.
    """
    alike = {} if shared_px is None else {"shared_px": shared_px}
    return contour_limb(
        taken.profiles,
        sample.grid.d_px,
        taken.places,
        sample.noise,
        sample.bundles.middle[good],
        taken.normal_px,
        pixel_rad_across(view, taken.px, taken.normal_px),
        **alike,
    )


def _coherent_px(
    places: EdgePlaces, glow_px: float, length_px: float, moved_px: np.ndarray | None
) -> float:
    """Error that neighbouring edges share where air glows, so far up, or no model places them.

    glow_px : length over which the glow fades, 0 without any, and length_px : over which air
    usually does. moved_px : (N,) how far a model moves edges from the steepest fall, along the
    limb; None without a model.
    """
    coherent_px = _COHERENT_PX[(glow_px > 0.0, moved_px is None)]
    if glow_px == 0.0:
        return min(coherent_px, scatter_px(places.offset_px))
    if moved_px is not None and len(moved_px) >= MIN_PROFILES:
        # Where these differ along the limb, the model does not hold.
        middles = medians(moved_px, STRETCHES)
        coherent_px = max(coherent_px, _MOVED_SHARE * float(np.std(middles)))
    return coherent_px * min(max(1.0, length_px / _FINE_PX), _FINEST)
