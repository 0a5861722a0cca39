"""What solves profiles of stretches for their edges, beside each texture."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from horizon_sensor_ros.core.limb.edge.near_edge import BESIDE_PX
from horizon_sensor_ros.core.limb.texture import ground_texture
from horizon_sensor_ros.core.limb.texture.depth import seen_depths
from horizon_sensor_ros.core.limb.texture.stretches import Stretches, samples_between
from horizon_sensor_ros.core.mathematics.normal_law import normal_cdf, normal_density

_LEVEL_SIGMA = 30.0  # over the noise; of a stretch's brightness about that of three
_SCALES_PER_OCTAVE = 2.0  # tables are made for such steps of the ground's scale


@dataclass(frozen=True, eq=False)
class Tables:
    """What solves profiles of J samples, over their noise, for each of S textures.

    Two unknowns of an edge are solved for: e, its distance from the predicted place, and w, by
    which its blur is wider than expected, both in pixels and times the step over the noise.
    weights : (3 J, 2 S) by which a profile between its two neighbours is multiplied for e (first S
    columns) and w (the others). sigma, widening_sigma : (S,) of e for a known w, and of w.
    textured : (S,) the part of sigma that the texture causes. lean : (S,) change of e with w.
    residual : (J, S J) takes one profile, less its edge, to what no level and background explain,
    whitened: its square is the cost. log_det : (S,) of the covariances that this is whitened by.
    slope, widening : (J,) derivatives of a unit step by e and w. rise : mean of a unit step at
    `BESIDE_PX`, where steps are measured.
    """

    weights: np.ndarray
    sigma: np.ndarray
    textured: np.ndarray
    widening_sigma: np.ndarray
    lean: np.ndarray
    residual: np.ndarray
    log_det: np.ndarray
    slope: np.ndarray
    widening: np.ndarray
    rise: float


def tables_of(stretches: Stretches, used: slice) -> Tables:
    """Tables for these stretches; their ground's scale is rounded, so that few are made."""
    octave = round(_SCALES_PER_OCTAVE * math.log2(stretches.px_over_radius))
    return _tables(
        tuple(stretches.d_px[used].tolist()),
        stretches.psf_px,
        2.0 ** (octave / _SCALES_PER_OCTAVE),
        round(stretches.length_px),
    )


@lru_cache(maxsize=64)
def _tables(
    d_px: tuple[float, ...], psf_px: float, px_over_radius: float, length_px: int
) -> Tables:
    x_px = np.array(d_px)
    num = len(x_px)
    root, blur = seen_depths(x_px, psf_px)
    across = ground_texture.along_sight(root, px_over_radius)
    along = np.arange(3) * (length_px * px_over_radius)
    texture, together = ground_texture.covariances(blur, across, along)
    slope = normal_density(x_px / psf_px) / psf_px
    widening = slope * (x_px / psf_px)
    free = np.stack([normal_cdf(-x_px / psf_px), np.ones(num)], axis=1)
    design = np.concatenate([np.kron(np.eye(3), slope[:, None]), np.tile(free, (3, 1))], axis=1)
    design = np.column_stack([design, np.tile(widening, 3)])
    # Light may change from stretch to stretch even where there is no texture.
    own_level = _LEVEL_SIGMA**2 * np.kron(np.eye(3), np.outer(free[:, 0], free[:, 0]))
    cov = together + own_level + np.eye(3 * num)
    weighted = np.linalg.solve(cov, design[None])
    information = np.swapaxes(weighted, 1, 2) @ design
    # The edge's place for a known blur, and the blur.
    known = np.linalg.inv(information[:, :-1, :-1])
    weights = np.einsum("sk,sjk->sj", known[:, 1], weighted[..., :-1])
    whole = np.linalg.inv(information)
    lower = np.linalg.cholesky(texture + np.eye(num))
    whiten = np.linalg.inv(lower)
    q, r = np.linalg.qr(whiten @ free)
    diagonals = np.diagonal(lower, axis1=1, axis2=2), np.diagonal(r, axis1=1, axis2=2)
    residual = whiten - q @ (np.swapaxes(q, 1, 2) @ whiten)
    return Tables(
        weights=np.concatenate([weights, np.einsum("sk,sjk->sj", whole[:, -1], weighted)]).T.copy(),
        sigma=np.sqrt(known[:, 1, 1]),
        textured=np.sqrt(np.einsum("sj,sjk,sk->s", weights, together, weights)),
        widening_sigma=np.sqrt(whole[:, -1, -1]),
        lean=weights @ design[:, -1],
        residual=residual.reshape(-1, num).T.copy(),
        log_det=np.asarray(
            sum(2.0 * np.log(np.abs(diagonal)).sum(axis=1) for diagonal in diagonals)
        ),
        slope=slope,
        widening=widening,
        rise=float(free[samples_between(x_px, *BESIDE_PX), 0].mean()),
    )
