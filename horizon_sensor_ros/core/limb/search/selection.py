"""Step two: which candidates are the limb, decided by one consensus over the rays of all cameras.

All cameras share nadir and the angular radius of the disc: three unknowns. Three oriented
candidates, from any cameras, give a hypothesis in closed form (``u . m = 1``, ``m = n / cos
rho``); the hypothesis that explains the most candidates, with their bright side towards the
planet, wins. Where the cone through all of them explains nearly all no others are tried.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.limb_rays import LimbRays
from horizon_sensor_ros.core.limb.search.candidates import LimbCandidates
from horizon_sensor_ros.core.limb.search.evenly import evenly
from horizon_sensor_ros.core.mathematics.rigid import cross
from horizon_sensor_ros.core.mathematics.robust import quantile
from horizon_sensor_ros.core.mathematics.symmetric3 import solve
from horizon_sensor_ros.core.status import Status

_NUM_DRAWS = 1500  # triples of candidates that are tried
_NUM_HYPOTHESES = 400  # of those that make sense, how many are scored
_LEAST_VOLUME = 1e-7  # of three rays that determine a cone
_PRESELECT = 128  # candidates that the first scoring looks at
_FINALISTS = 24
_POLISHED = 3
_NEAR, _NEARLY_ALL = 2.0, 0.9  # tolerances from the cone of all; weight that leaves no other one
_COS_POLARITY = 0.8  # the edge's normal lies within 37 deg of the hypothesis' outward direction
MIN_INLIERS = 12
_TOLERANCE = 1.5  # candidate grid steps across the limb, within which a candidate agrees
_ON_THE_LIMB = 3.0  # candidate grid steps that edges of a limb without glow are seen off it
_LEAST_SEEN = 0.8  # of a camera's candidates that have a ray
_INNER_TRUST = 0.5  # of a candidate that has another one farther out


@dataclass(frozen=True, eq=False)
class RayCandidates:
    """Candidates of all cameras as rays in the base frame.

    rays (N, 3) unit; outward (N, 3) unit, tangent to the sphere of directions, towards the dark
    side; pitch_rad (N,) angle of one candidate grid step; weight (N,) in (0, 1]; camera (N,) index
    of the view; beyond_rad (N,) angle outwards to the very edge.
    """

    rays: np.ndarray
    outward: np.ndarray
    pitch_rad: np.ndarray
    weight: np.ndarray
    camera: np.ndarray
    beyond_rad: np.ndarray

    def placed(self) -> RayCandidates:
        """Candidates moved outwards, to their very edges."""
        rays = self.rays + self.beyond_rad[:, None] * self.outward
        rays /= np.sqrt(np.einsum("ij,ij->i", rays, rays))[:, None]
        return replace(self, rays=rays)

    def take(self, keep: np.ndarray) -> RayCandidates:
        """Those that a mask (N,) tells."""
        some = np.flatnonzero(keep)
        return RayCandidates(*(getattr(self, name)[some] for name in self.__dataclass_fields__))

    def of_camera(self, index: int) -> RayCandidates:
        """Those of one camera, as if there were no other."""
        those = self.take(self.camera == index)
        return replace(those, camera=np.zeros_like(those.camera))

    def outside(self, nadir_base: np.ndarray, rho_rad: float) -> np.ndarray:
        """Which (N,) lie farther outside a cone than edges of its limb are seen to."""
        cosine = np.minimum(np.maximum(self.rays @ nadir_base, -1.0), 1.0)
        off = np.arccos(cosine) - rho_rad
        return np.asarray(off > _ON_THE_LIMB * self.pitch_rad)


@dataclass(frozen=True, eq=False)
class Consensus:
    """The disc on which the candidates agree.

    Not OK: a reason, and a cone of NaN, unless the status is that of a layer of airglow without
    ground.

    nadir_base (3,), rho_rad : the cone of its limb.
    inliers : (N,) which of the candidates agree.
    unanimous : nearly all of them do, and the cone lies as near to the limb as they do.
    layer_rad : how far above the limb the edge of a layer of airglow lies, which the inliers then
    are on; 0 where there is none.
    by_day : the consensus before it was taken for such an edge, where air that is lit by day may
    look like that too.
    perhaps_layer : the limb may be such an edge, and how light fades below it does not tell.
    """

    status: Status
    reason: str = ""
    nadir_base: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    rho_rad: float = np.nan
    inliers: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=bool))
    unanimous: bool = False
    layer_rad: float = 0.0
    by_day: Consensus | None = None
    perhaps_layer: bool = False

    @property
    def below_layer(self) -> bool:
        """Whether the edge of a layer of airglow lies above the limb."""
        return self.layer_rad > 0.0

    def apart_px(self, limb: LimbRays, pitch_rad: float) -> float:
        """How far nine tenths of a limb's points lie off the cone at most, pixels of this pitch."""
        angle_rad = limb.angles(self.nadir_base)[0]
        return quantile(np.abs(angle_rad - self.rho_rad), 0.9) / pitch_rad


def rays_of_candidates(
    views: Sequence[CameraView], candidates: Sequence[LimbCandidates]
) -> RayCandidates:
    """Put the candidates of every camera into the base frame; those without a ray are dropped, and
    all of a camera of which most have none: its lens is another than it is told to be.
    """
    rays, outward, pitch, weight, index, beyond = [], [], [], [], [], []
    for i, (view, found) in enumerate(zip(views, candidates, strict=True)):
        if len(found) == 0:
            continue
        ends = view.camera.rays(np.concatenate([found.px, found.px + found.normal_px]))
        here, there = ends[: len(found)], ends[len(found) :]
        along = there - here
        along -= np.einsum("ij,ij->i", along, here)[:, None] * here
        angle_per_px = np.sqrt(np.einsum("ij,ij->i", along, along))
        ok = np.isfinite(angle_per_px) & (angle_per_px > 0)
        if np.count_nonzero(ok) < _LEAST_SEEN * len(found):
            continue
        rays.append(here[ok] @ view.rot_base_from_cam.T)
        outward.append((along[ok] / angle_per_px[ok, None]) @ view.rot_base_from_cam.T)
        pitch.append(angle_per_px[ok] * found.pitch_px)
        strong = quantile(found.contrast, 0.9)
        trust = np.minimum(np.maximum(found.contrast / (0.3 * strong), 0.2), 1.0)
        if found.outermost is not None:
            trust[~found.outermost] *= _INNER_TRUST
        weight.append(trust[ok])
        offset_px = found.beyond_px if len(found.beyond_px) else np.zeros(len(found))
        beyond.append((angle_per_px * offset_px)[ok])
        index.append(np.full(int(ok.sum()), i))
    if not rays:
        none = np.empty((0, 3))
        empty = np.empty(0)
        return RayCandidates(none, none, empty, empty, np.empty(0, dtype=int), empty)
    return RayCandidates(
        np.concatenate(rays),
        np.concatenate(outward),
        np.concatenate(pitch),
        np.concatenate(weight),
        np.concatenate(index),
        np.concatenate(beyond),
    )


# Calibrations that make no sense have rays of any spacing: no consensus, and no warning either.
@np.errstate(over="ignore", invalid="ignore")
def limb_consensus(
    candidates: RayCandidates, *, rho_min_rad: float, rho_max_rad: float
) -> Consensus:
    """Choose nadir and disc radius that explain the most candidates.

    The draw of hypotheses is seeded: the same candidates give the same answer. Fewer than
    `MIN_INLIERS` candidates that agree: status NO_LIMB.
    """
    count = len(candidates.rays)
    if count < MIN_INLIERS:
        return Consensus(Status.NO_LIMB, f"{count} candidates of a space boundary in all frames")
    whole = _Ballot.of(candidates, _TOLERANCE)
    cos_min, cos_max = math.cos(rho_max_rad), math.cos(rho_min_rad)
    nadirs, cos_rhos = whole.nearest()
    unanimous = bool(
        whole.scores(nadirs, cos_rhos, _NEAR)[0] > _NEARLY_ALL * whole.weight.sum()
        and cos_min <= cos_rhos[0] <= cos_max
    )
    if unanimous:
        whole = _Ballot.of(candidates.placed(), _TOLERANCE)
    else:
        nadirs, cos_rhos = _hypotheses(candidates, np.random.default_rng(count), cos_min, cos_max)
        if len(nadirs) == 0:
            return Consensus(Status.NO_LIMB, "no three candidates fit a disc of plausible altitude")
        some = whole.thinned(_PRESELECT) if count > _PRESELECT else whole
        best = np.argsort(some.scores(nadirs, cos_rhos))[: -_FINALISTS - 1 : -1]
        nadirs, cos_rhos = nadirs[best], cos_rhos[best]
        best = np.argsort(whole.scores(nadirs, cos_rhos))[: -_POLISHED - 1 : -1]
        nadirs, cos_rhos = nadirs[best], cos_rhos[best]
    nadirs, cos_rhos = whole.polished(nadirs, cos_rhos)
    gains = whole.gains(nadirs, cos_rhos)
    scores = whole.weight @ gains
    scores[~((cos_rhos >= cos_min) & (cos_rhos <= cos_max))] = -np.inf
    champion = int(np.argmax(scores))
    if not np.isfinite(scores[champion]):
        return Consensus(Status.NO_LIMB, "no consensus of the candidates at a plausible altitude")
    inliers = gains[:, champion] > 0.0
    num_inliers = int(np.count_nonzero(inliers))
    if num_inliers < MIN_INLIERS:
        return Consensus(Status.NO_LIMB, f"only {num_inliers} candidates agree on a disc")
    nadir, rho = nadirs[champion], math.acos(cos_rhos[champion])
    return Consensus(Status.OK, "", nadir, rho, inliers, unanimous)


def consensus_about(candidates: RayCandidates, nadir_base: np.ndarray, rho_rad: float) -> Consensus:
    """`limb_consensus` on a cone, nadir (3,) and rho, that is known from elsewhere, with the
    candidates that agree; status NO_LIMB where too few do.
    """
    gains = _Ballot.of(candidates, _TOLERANCE).gains(nadir_base[None], np.cos([rho_rad]))
    inliers = gains[:, 0] > 0.0
    num_inliers = int(np.count_nonzero(inliers))
    if num_inliers < MIN_INLIERS:
        return Consensus(Status.NO_LIMB, f"only {num_inliers} candidates agree on a disc")
    return Consensus(Status.OK, "", nadir_base, rho_rad, inliers)


def _hypotheses(
    candidates: RayCandidates, rng: np.random.Generator, cos_min: float, cos_max: float
) -> tuple[np.ndarray, np.ndarray]:
    """Cones through random triples of candidates whose edges point the right way.

    The first `_NUM_HYPOTHESES` that make sense; where most do, half of the draw yields as many.
    """
    triples = rng.integers(0, len(candidates.rays), size=(_NUM_DRAWS, 3))
    half = _NUM_DRAWS // 2
    nadirs, cos_rhos = _cones(candidates, triples[:half], cos_min, cos_max)
    if len(nadirs) < _NUM_HYPOTHESES:
        more = _cones(candidates, triples[half:], cos_min, cos_max)
        nadirs, cos_rhos = np.concatenate([nadirs, more[0]]), np.concatenate([cos_rhos, more[1]])
    return nadirs[:_NUM_HYPOTHESES], cos_rhos[:_NUM_HYPOTHESES]


def _cones(
    candidates: RayCandidates, triples: np.ndarray, cos_min: float, cos_max: float
) -> tuple[np.ndarray, np.ndarray]:
    """Cones through triples (M, 3) of candidates, those that make sense.

    The tips of three rays lie in the plane ``x . nadir = cos rho``.
    """
    first, second, third = candidates.rays[triples.T]
    normal = cross(second - first, third - first)
    norm = np.sqrt(np.einsum("ij,ij->i", normal, normal))
    drop = np.einsum("ij,ij->i", normal, first)
    with np.errstate(divide="ignore", invalid="ignore"):
        cos_rho = np.abs(drop) / norm
        nadir = normal / np.copysign(norm, drop)[:, None]
        ok = (np.abs(drop) > _LEAST_VOLUME) & (cos_rho >= cos_min) & (cos_rho <= cos_max)
    nadir, cos_rho, triples = nadir[ok], cos_rho[ok], triples[ok]
    # Outwards along the edge's normal, u . n falls; for a perfect edge at the rate sin rho.
    fall = -np.einsum("khc,hc->kh", candidates.outward[triples.T], nadir)
    sin_rho = np.sqrt(np.maximum(1.0 - cos_rho**2, 1e-12))
    ok = (fall > _COS_POLARITY * sin_rho).all(axis=0)
    return nadir[ok], cos_rho[ok]


@dataclass(frozen=True, eq=False)
class _Ballot:
    """Candidates as they vote on hypotheses; in single precision, it is a matter of grid steps."""

    rays: np.ndarray
    outward: np.ndarray
    tolerance_rad: np.ndarray
    weight: np.ndarray

    @staticmethod
    def of(candidates: RayCandidates, tolerance: float) -> _Ballot:
        parts = (
            candidates.rays,
            candidates.outward,
            tolerance * candidates.pitch_rad,
            candidates.weight,
        )
        return _Ballot(*(part.astype(np.float32) for part in parts))

    def thinned(self, count: int) -> _Ballot:
        keep = evenly(len(self.rays), count)
        return _Ballot(*(getattr(self, name)[keep] for name in self.__dataclass_fields__))

    def gains(self, nadirs: np.ndarray, cos_rhos: np.ndarray, widen: float = 1.0) -> np.ndarray:
        """Truncated quadratic gain (N, H) of each candidate in each hypothesis, at most one."""
        directions = nadirs.T.astype(np.float32)
        cosines = cos_rhos.astype(np.float32)
        sines = np.sqrt(1.0 - cosines * cosines)
        gain = self.rays @ directions
        gain -= cosines
        gain *= 1.0 / (widen * self.tolerance_rad)[:, None]
        gain *= gain
        gain *= -1.0 / (sines * sines)
        gain += 1.0
        np.maximum(gain, 0.0, out=gain)
        np.copyto(gain, 0.0, where=~((self.outward @ directions) < -_COS_POLARITY * sines))
        return gain

    def scores(self, nadirs: np.ndarray, cos_rhos: np.ndarray, widen: float = 1.0) -> np.ndarray:
        """Sum (H,) of the candidates' gains by their weight."""
        return np.asarray(self.weight @ self.gains(nadirs, cos_rhos, widen))

    def nearest(self) -> tuple[np.ndarray, np.ndarray]:
        """The cone (1, 3), (1,) that is the least squares of all; NaN where there is none."""
        rays = self.rays.astype(np.float64)
        weighted = rays * np.square(self.weight / self.tolerance_rad)[:, None]
        m = solve(weighted.T @ rays, weighted.sum(axis=0))
        cos_rho = 1.0 / max(math.sqrt(m @ m), 1e-9)
        return m[None] * cos_rho, np.array([cos_rho])

    def polished(self, nadirs: np.ndarray, cos_rhos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Least squares over the inliers of each, a few rounds with the tolerance drawn in.

        A hypothesis that loses its inliers on the way stays as it was.
        """
        rays = self.rays.astype(np.float64)
        weighted = rays * np.square(self.weight / self.tolerance_rad)[:, None]
        products = (weighted[:, :, None] * rays[:, None, :]).reshape(-1, 9)
        for widen in (2.0, 1.5, 1.0):
            inlying = (self.gains(nadirs, cos_rhos, widen) > 0.0).T.astype(np.float64)
            # Least squares of u . m = 1, m = nadir / cos rho.
            for k, (matrix, right) in enumerate(
                zip(inlying @ products, inlying @ weighted, strict=True)
            ):
                m = solve(matrix.reshape(3, 3), right)
                norm = math.sqrt(m @ m)
                if inlying[k].sum() >= MIN_INLIERS and 1.0 < norm < math.inf:
                    nadirs[k], cos_rhos[k] = m / norm, 1.0 / norm
        return nadirs, cos_rhos
