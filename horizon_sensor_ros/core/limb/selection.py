"""Step two: which candidates are the limb, decided by one consensus over the rays of all cameras.

All cameras share nadir and the angular radius of the disc: three unknowns. Three oriented
candidates, from any cameras, give a hypothesis in closed form (``u . m = 1``, ``m = n / cos
rho``); the hypothesis that explains the most candidates, with their bright side towards the
planet, wins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from horizon_sensor_ros.core.camera import CameraView
from horizon_sensor_ros.core.limb.candidates import LimbCandidates
from horizon_sensor_ros.core.status import Status

_NUM_HYPOTHESES = 1500
_PRESELECT = 128  # candidates that the first scoring looks at
_FINALISTS = 24
_COS_POLARITY = 0.8  # the edge's normal lies within 37 deg of the hypothesis' outward direction
MIN_INLIERS = 12
_INNER_TRUST = 0.5  # of a candidate that has another one farther out


@dataclass(frozen=True)
class RayCandidates:
    """Candidates of all cameras as rays in the base frame.

    rays (N, 3) unit; outward (N, 3) unit, tangent to the sphere of directions, towards the dark
    side; pitch_rad (N,) angle of one candidate grid step; weight (N,) in (0, 1]; camera (N,) index
    of the view.
    """

    rays: np.ndarray
    outward: np.ndarray
    pitch_rad: np.ndarray
    weight: np.ndarray
    camera: np.ndarray


@dataclass(frozen=True)
class Consensus:
    """The winning hypothesis; `inliers` is a mask over the ray candidates. Not OK: NaN and a
    reason.
    """

    status: Status
    reason: str = ""
    nadir_base: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    rho_rad: float = np.nan
    inliers: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=bool))


def rays_of_candidates(
    views: Sequence[CameraView], candidates: Sequence[LimbCandidates]
) -> RayCandidates:
    """Put the candidates of every camera into the base frame; those without a ray are dropped."""
    rays, outward, pitch, weight, index = [], [], [], [], []
    for i, (view, found) in enumerate(zip(views, candidates, strict=True)):
        if len(found) == 0:
            continue
        ends = view.camera.rays(np.concatenate([found.px, found.px + found.normal_px]))
        here, there = ends[: len(found)], ends[len(found) :]
        along = there - here
        along -= np.sum(along * here, axis=1, keepdims=True) * here
        angle_per_px = np.linalg.norm(along, axis=1)
        ok = np.isfinite(angle_per_px) & (angle_per_px > 0)
        rays.append(here[ok] @ view.rot_base_from_cam.T)
        outward.append((along[ok] / angle_per_px[ok, None]) @ view.rot_base_from_cam.T)
        pitch.append(angle_per_px[ok] * found.pitch_px)
        strong = np.percentile(found.contrast, 90)
        trust = np.clip(found.contrast / (0.3 * strong), 0.2, 1.0)
        if found.outermost is not None:
            trust[~found.outermost] *= _INNER_TRUST
        weight.append(trust[ok])
        index.append(np.full(int(ok.sum()), i))
    if not rays:
        none = np.empty((0, 3))
        return RayCandidates(none, none, np.empty(0), np.empty(0), np.empty(0, dtype=int))
    return RayCandidates(
        np.concatenate(rays),
        np.concatenate(outward),
        np.concatenate(pitch),
        np.concatenate(weight),
        np.concatenate(index),
    )


def limb_consensus(
    found: RayCandidates, *, rho_min_rad: float, rho_max_rad: float, tolerance: float = 1.5
) -> Consensus:
    """Choose nadir and disc radius that explain the most candidates.

    tolerance : in candidate grid steps, across the limb. The draw of hypotheses is seeded: the
    same candidates give the same answer. Fewer than `MIN_INLIERS` candidates that agree: status
    NO_LIMB.
    """
    count = len(found.rays)
    if count < MIN_INLIERS:
        return Consensus(Status.NO_LIMB, f"{count} candidates of a space boundary in all frames")
    rng = np.random.default_rng(count)
    nadirs, cos_rhos = _hypotheses(found, rng, np.cos(rho_max_rad), np.cos(rho_min_rad))
    if len(nadirs) == 0:
        return Consensus(Status.NO_LIMB, "no three candidates fit a disc of plausible altitude")
    tol_rad = tolerance * found.pitch_rad
    subset = np.linspace(0, count - 1, min(count, _PRESELECT)).astype(np.intp)
    first = _scores(found, subset, tol_rad, nadirs, cos_rhos)
    best = np.argsort(first)[::-1][:_FINALISTS]
    everything = np.arange(count)
    finals = _scores(found, everything, tol_rad, nadirs[best], cos_rhos[best])
    order = np.argsort(finals)[::-1]
    champion: tuple[float, np.ndarray, float] | None = None
    for k in order[:4]:
        nadir, cos_rho = nadirs[best[k]], float(cos_rhos[best[k]])
        nadir, cos_rho = _polish(found, tol_rad, nadir, cos_rho)
        rho = np.arccos(np.clip(cos_rho, -1.0, 1.0))
        if not rho_min_rad <= rho <= rho_max_rad:
            continue
        score = float(_scores(found, everything, tol_rad, nadir[None], np.array([cos_rho]))[0])
        if champion is None or score > champion[0]:
            champion = (score, nadir, cos_rho)
    if champion is None:
        return Consensus(Status.NO_LIMB, "no consensus of the candidates at a plausible altitude")
    _, nadir, cos_rho = champion
    inliers = _inliers(found, tol_rad, nadir, cos_rho)
    if inliers.sum() < MIN_INLIERS:
        return Consensus(Status.NO_LIMB, f"only {int(inliers.sum())} candidates agree on a disc")
    return Consensus(Status.OK, "", nadir, float(np.arccos(cos_rho)), inliers)


def _hypotheses(
    found: RayCandidates, rng: np.random.Generator, cos_min: float, cos_max: float
) -> tuple[np.ndarray, np.ndarray]:
    """Cones through random triples of candidates whose edges point the right way."""
    triples = rng.integers(0, len(found.rays), size=(_NUM_HYPOTHESES, 3))
    matrix = found.rays[triples]
    det = np.linalg.det(matrix)
    matrix, triples = matrix[np.abs(det) > 1e-7], triples[np.abs(det) > 1e-7]
    if len(matrix) == 0:
        return np.empty((0, 3)), np.empty(0)
    m = np.linalg.solve(matrix, np.ones((len(matrix), 3, 1)))[..., 0]
    norm = np.linalg.norm(m, axis=1)
    nadir, cos_rho = m / norm[:, None], 1.0 / norm
    sin_rho = np.sqrt(np.maximum(1.0 - cos_rho**2, 1e-12))
    # Outwards along the edge's normal, u . n falls; for a perfect edge at the rate sin rho.
    fall = -np.einsum("hkc,hc->hk", found.outward[triples], nadir)
    ok = (cos_rho >= cos_min) & (cos_rho <= cos_max)
    ok &= (fall > _COS_POLARITY * sin_rho[:, None]).all(axis=1)
    return nadir[ok], cos_rho[ok]


def _scores(
    found: RayCandidates,
    subset: np.ndarray,
    tol_rad: np.ndarray,
    nadirs: np.ndarray,
    cos_rhos: np.ndarray,
) -> np.ndarray:
    """Truncated quadratic score of each hypothesis over a subset of the candidates."""
    sin_rhos = np.sqrt(1.0 - cos_rhos**2)
    off = (found.rays[subset] @ nadirs.T - cos_rhos) / (tol_rad[subset, None] * sin_rhos)
    gain = np.maximum(0.0, 1.0 - off * off)
    gain *= (found.outward[subset] @ nadirs.T) < -_COS_POLARITY * sin_rhos
    return found.weight[subset] @ gain


def _inliers(
    found: RayCandidates, tol_rad: np.ndarray, nadir: np.ndarray, cos_rho: float
) -> np.ndarray:
    sin_rho = np.sqrt(1.0 - cos_rho**2)
    off = np.abs(found.rays @ nadir - cos_rho) / (tol_rad * sin_rho)
    return (off < 1.0) & (found.outward @ nadir < -_COS_POLARITY * sin_rho)


def _polish(
    found: RayCandidates, tol_rad: np.ndarray, nadir: np.ndarray, cos_rho: float
) -> tuple[np.ndarray, float]:
    """Least squares over the inliers, a few rounds with the tolerance drawn in."""
    for widen in (2.0, 1.5, 1.0):
        inliers = _inliers(found, widen * tol_rad, nadir, cos_rho)
        if inliers.sum() < MIN_INLIERS:
            break
        scale = found.weight[inliers] / tol_rad[inliers]
        m, *_ = np.linalg.lstsq(found.rays[inliers] * scale[:, None], scale, rcond=None)
        norm = float(np.linalg.norm(m))
        if not np.isfinite(norm) or norm <= 1.0:
            break
        nadir, cos_rho = m / norm, 1.0 / norm
    return nadir, cos_rho
