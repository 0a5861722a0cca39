"""Edges where light ends, falls inwards, or is too bright for the exposure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.limb.edge.clipping import place_clipped_edges
from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.edge.terminator import fading_ends
from horizon_sensor_ros.core.limb.edge_by_edge.edges import LimbEdges, believable
from horizon_sensor_ros.core.limb.glow.white_air import PART_TURNS
from horizon_sensor_ros.core.limb.profiles import EdgePlaces
from horizon_sensor_ros.core.limb.sample import MIN_PROFILES, LimbSample
from horizon_sensor_ros.core.limb_points import NOTHING_SHARED, SharedError

# What neighbouring edges share of their errors in light that falls inwards, whose law is fitted to
# three of them together.
_ALIKE_IN_LIGHT = 0.5


def lit_edges(
    sample: LimbSample, edges: LimbEdges, looks: Sequence[EdgeLook]
) -> tuple[EdgePlaces, np.ndarray, SharedError]:
    """As `_with_feet`, good without those at ends where light fades."""
    places, good, shared = _with_feet(sample, edges, looks)
    # Until looks are known light beyond the edges may be air's, which fades otherwise.
    if looks and all(look.glow_px == 0.0 for look in looks):
        good = at_limb(sample, places.step, good)
    return places, good, shared


def _with_feet(
    sample: LimbSample, edges: LimbEdges, looks: Sequence[EdgeLook]
) -> tuple[EdgePlaces, np.ndarray, SharedError]:
    """Places of edges (M,), which of them are good, and the error that clipped ones share: without
    glow these are placed by their feet.
    """
    clipped = sample.clipped
    if not clipped.any() or any(look.glow_px > 0 for look in looks):
        return edges.places, edges.good, NOTHING_SHARED
    # One lens blurs them all.
    shown = not edges.model_free and np.count_nonzero(edges.good & ~clipped) >= MIN_PROFILES
    blur_px = looks[0].psf_px if shown else None
    places, shared = _with_clipped(sample, clipped, edges.places, blur_px)
    return places, (edges.good & ~clipped) | (clipped & believable(places)), shared


def _with_clipped(
    sample: LimbSample, clipped: np.ndarray, places: EdgePlaces, shown_blur_px: float | None
) -> tuple[EdgePlaces, SharedError]:
    """Places with those of clipped edges (M,) as their feet tell them, and the error they share.

    shown_blur_px : as of `place_clipped_edges`.
    """
    found = place_clipped_edges(
        sample.profiles[clipped],
        sample.grid.d_px,
        sample.white,
        sample.noise,
        sample.grid.reach_px,
        shown_blur_px,
        demosaiced=sample.demosaiced,
    )
    # Texture may end beside these edges as it does beside the others.
    sigma_px = np.hypot(found.places.sigma_px, places.sigma_px[clipped])
    by = replace(found.places, sigma_px=sigma_px)
    share = float(np.mean(clipped))
    # A part of a limb that is off, and the rest not, turns it: by the slope of a line fitted to
    # both, the part at one end, as it is where brightness grows along the limb.
    turned_px = PART_TURNS * share * (1.0 - share) * found.shared.shift_px
    return places.replaced(clipped, by), found.shared.times(share)._replace(slope_px=turned_px)


def at_limb(sample: LimbSample, step: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Which of good edges (M,) lie where the planet ends, not at an end where its light does.

    step : (M,) as of `EdgePlaces`.
    """
    if good.all():
        lit = ~fading_ends(sample.profiles, sample.grid, step)
    else:
        where = np.flatnonzero(good)
        lit = good.copy()
        lit[where] = ~fading_ends(sample.profiles[where], sample.grid, step[where])
    if sample.light is not None:
        lit &= ~sample.light.faded(good)
    return lit


def in_falling_light(
    sample: LimbSample, places: EdgePlaces, good: np.ndarray
) -> tuple[EdgePlaces, SharedError]:
    """Places of edges (M,), and what good ones share, with what `FallingLight` leaves open."""
    if sample.light is None or not good.any():
        return places, NOTHING_SHARED
    sigma_px = sample.light.sigma_px
    coherent_px = float(np.sqrt(np.mean(np.square(sigma_px[good]))))
    places = replace(places, sigma_px=np.hypot(places.sigma_px, sigma_px))
    return places, SharedError(_ALIKE_IN_LIGHT * coherent_px)
