"""Least squares over all frame sets: how the cameras are mounted, how surely, and what stays open.

Gauss-Newton with each set's nadir and rho eliminated (`normal_equations`), each set weighted by
Tukey's function of its own residual, so that frames with a wrong horizon have no say. Directions
of the unknowns that the sets do not tell are left as they are and named (`observability`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.mathematics.attitude import require_rotation, tangent_basis
from horizon_sensor_ros.core.mathematics.rigid import vector_from_rotation
from horizon_sensor_ros.core.mathematics.robust import TUKEY_SIGMAS
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.self_calibration.measurement import FrameSet
from horizon_sensor_ros.core.self_calibration.normal_equations import Model, SetEquations
from horizon_sensor_ros.core.self_calibration.observability import (
    observed_directions,
    unobserved_in_words,
)
from horizon_sensor_ros.core.self_calibration.result import Calibration, CalibrationConfig
from horizon_sensor_ros.core.self_calibration.unknowns import Unknowns
from horizon_sensor_ros.core.status import Status

MIN_SETS = 5
_MAX_ROUNDS = 50
# Squared length, in sigmas of the residuals, of the last step.
_CONVERGED = 1e-8
# What moves by more than this at the end has not come to rest; less is Tukey's weights swinging.
_AT_REST = 1e-2
# Sets that scatter more than this many times what their limbs claim have no mounting in common.
_MAX_SCALE = 10.0
# An altitude so many radii from what the limbs show is none.
_HIGHEST = 0.05
# Share of a motion that is held still from which on what is measured of it goes elsewhere.
_OPEN = 0.3


def calibrate(
    sets: Sequence[FrameSet],
    rot_base_from_cam: Mapping[str, np.ndarray],
    planet: Planet,
    config: CalibrationConfig | None = None,
) -> Calibration:
    """Find how the cameras are mounted from what each saw of the horizon at many moments.

    sets : in order of time. rot_base_from_cam : (3, 3), nominal, by camera; the first stays as it
    is unless a set has a reference attitude. planet : the sphere that was fitted; its limb height
    is what the found one adds to. Too few sets, or sets that do not agree: a status that is
    not OK, and why. Raises ValueError for a horizon of a camera that is not among them.
    """
    config = CalibrationConfig() if config is None else config
    nominal = {c: require_rotation(rot, c) for c, rot in rot_base_from_cam.items()}
    unknown = {h.camera for s in sets for h in s.horizons} - set(nominal)
    if unknown:
        raise ValueError(f"no rotation for {', '.join(sorted(unknown))}")
    unknowns = Unknowns(tuple(nominal), config.drift, config.focal)
    telling = tuple(s for s in sets if s.horizons and s.num_residuals > 3)
    if len(telling) < MIN_SETS:
        reason = (
            f"{len(telling)} of {len(sets)} frame sets show the horizon to two cameras (or to one, "
            f"with a reference), {MIN_SETS} needed"
        )
        return Calibration.none(Status.TOO_FEW_POINTS, reason, unknowns, nominal, telling)
    off_m = _altitude_off_m(telling, planet)
    if abs(off_m) > _HIGHEST * planet.mean_radius_m:
        reason = (
            f"the altitude that was given is {off_m / 1e3:+.0f} km from what the limbs show: is it "
            "in metres above the surface, and of this recording?"
        )
        return Calibration.none(Status.ALTITUDE_OUT_OF_RANGE, reason, unknowns, nominal, telling)
    adjustment = _adjusted(telling, nominal, planet, unknowns, config)
    # What is held still although measurements of it are used would go into the rotations.
    without = _without_unsure(telling, adjustment)
    if without is not None:
        if len(without) < MIN_SETS:
            reason = (
                "the reference, or the altitude, is not sure enough, and without it "
                f"{len(without)} of {len(sets)} frame sets tell something, {MIN_SETS} needed"
            )
            return Calibration.none(Status.ILL_CONDITIONED, reason, unknowns, nominal, telling)
        adjustment = _adjusted(without, nominal, planet, unknowns, config)
    if adjustment.scale > _MAX_SCALE:
        reason = f"the frame sets scatter {adjustment.scale:.0f} times as much as their limbs claim"
        none = Calibration.none(Status.POOR_FIT, reason, unknowns, nominal, telling)
        return replace(none, scatter=adjustment.scale)
    status, reason = _objection(adjustment)
    if status is not Status.OK:
        return Calibration.none(status, reason, unknowns, nominal, telling)
    return adjustment.result(telling, nominal)


def _adjusted(
    sets: Sequence[FrameSet],
    nominal: Mapping[str, np.ndarray],
    planet: Planet,
    unknowns: Unknowns,
    config: CalibrationConfig,
) -> _Adjustment:
    """The adjustment of what is known well enough with all that its sigmas hold."""
    model = Model(sets, planet, unknowns)
    adjustment = _Adjustment(model, nominal, config)
    # With fewer directions that move, other sets may have no say, and what is left be less sure.
    while (known := adjustment.known) is not None:
        adjustment = _Adjustment(model, nominal, config, known)
    return adjustment


def _objection(adjustment: _Adjustment) -> tuple[Status, str]:
    """Status that is not OK, and why, where the mountings that were found are not to be believed,
    for all that the sets agree.
    """
    opposite = adjustment.opposite()
    if opposite:
        return Status.POOR_FIT, (
            f"{', '.join(opposite)} would see nadir opposite to where the frames show it: mounted "
            "otherwise than the rotations say?"
        )
    if adjustment.last_step2 > _AT_REST:
        return Status.NOT_CONVERGED, (
            f"after {_MAX_ROUNDS} rounds the mountings still move by "
            f"{np.sqrt(adjustment.last_step2):.1f} sigma a round: the sets do not agree on any"
        )
    return Status.OK, ""


def _without_unsure(
    sets: Sequence[FrameSet], adjustment: _Adjustment
) -> tuple[FrameSet, ...] | None:
    """The sets without altitudes that leave limb height open, and without references that leave it
    open how all cameras sit together; None where there are no such.
    """
    no_altitude = adjustment.leaves_limb_height_open and any(s.altitude for s in sets)
    no_reference = adjustment.leaves_all_open and any(s.reference for s in sets)
    if not (no_altitude or no_reference):
        return None
    kept = (
        replace(
            each,
            altitude=None if no_altitude else each.altitude,
            reference=None if no_reference else each.reference,
        )
        for each in sets
    )
    return tuple(each for each in kept if each.num_residuals > 3)


def _altitude_off_m(sets: Sequence[FrameSet], planet: Planet) -> float:
    """Altitudes that are known less those by the limbs, in the median; 0 without any."""
    off_m = [
        each.altitude.altitude_m - planet.altitude_from_rho(each.horizons[0].rho_rad)
        for each in sets
        if each.altitude is not None
    ]
    return float(np.median(off_m)) if off_m else 0.0


class _Adjustment:
    """The iteration to its end.

    within : (F, K) orthonormal directions, of the free unknowns in natural units, outside of which
    nothing moves; by default all that the limbs' noise would tell.
    scale : of the sets' residuals, over the claimed. last_step2 : squared length of the last step,
    in sigmas.
    """

    def __init__(
        self,
        model: Model,
        nominal: Mapping[str, np.ndarray],
        config: CalibrationConfig,
        within: np.ndarray | None = None,
    ) -> None:
        self._within = within
        self._model = model
        self._config = config
        self._units = model.unknowns.scales
        times = np.array([s.time_s for s in model.sets])
        self._alike = sets_alike(times, config.correlation_s)
        self._free = self._free_unknowns()
        state = model.start(nominal)
        for _ in range(_MAX_ROUNDS):
            equations = [model.equations(state, i) for i in range(len(model.sets))]
            weight, scale = _weights(equations)
            step, self.last_step2 = self._step(equations, weight)
            state = model.stepped(state, step, equations)
            if self.last_step2 < _CONVERGED:
                break
        self.scale = scale
        self._state = state
        self._equations, self._weight = equations, weight
        information, _ = self._information(equations, weight)
        free = information[np.ix_(self._free, self._free)]
        # What is observed at the end: eigenvalues (K,) and directions (F, K).
        self._values, self._seen = self._directions(free)

    @property
    def leaves_limb_height_open(self) -> bool:
        """Whether limb height is held still."""
        height = self._model.unknowns.where("limb_height")[0]
        return self._held_share(np.eye(len(self._units))[height]) > _OPEN

    @property
    def leaves_all_open(self) -> bool:
        """Whether all cameras together are held still about an axis across nadir."""
        unknowns = self._model.unknowns
        middle = self._state.nadir_base.mean(axis=0)
        across = tangent_basis(middle / np.linalg.norm(middle)).T
        return any(
            self._held_share(unknowns.vector("rotation", unknowns.cameras, axis)) > _OPEN
            for axis in across
        )

    def _held_share(self, motion: np.ndarray) -> float:
        """Share (0 to 1) of a motion (P,), in the unknowns' natural units, that is held still."""
        direction = motion[self._free] / np.linalg.norm(motion[self._free])
        return 1.0 - float(np.sum((self._seen.T @ direction) ** 2))

    @property
    def known(self) -> np.ndarray | None:
        """Those of its directions (F, K) that are known well enough with all that their sigmas
        hold; None where these are all of them.
        """
        if len(self._values) == 0:
            return None
        variances, vectors = np.linalg.eigh(self._covariance_within())
        known = variances <= self._config.max_sigma**2
        return None if known.all() else self._seen @ vectors[:, known]

    def opposite(self) -> list[str]:
        """Cameras in whose frames nadir comes out opposite to where they measured it: in residuals
        across it that is the same.
        """
        state, found = self._state, set()
        for each, nadir, weight in zip(
            self._model.sets, state.nadir_base, self._weight, strict=True
        ):
            for horizon in each.horizons if weight > 0.0 else ():
                if (state.rot_base_from_cam[horizon.camera] @ horizon.nadir_cam) @ nadir < 0.0:
                    found.add(horizon.camera)
        return sorted(found)

    @property
    def held(self) -> str:
        """The first camera that saw a horizon: without a reference it holds still."""
        seen = {h.camera for s in self._model.sets for h in s.horizons}
        return next(c for c in self._model.unknowns.cameras if c in seen)

    def _free_unknowns(self) -> np.ndarray:
        """Indices of what may move."""
        unknowns, sets = self._model.unknowns, self._model.sets
        held = (self.held,) if all(s.reference is None for s in sets) else ()
        return np.array(
            [
                i
                for i, unknown in enumerate(unknowns.all)
                if not (unknown.camera in held and unknown.kind in ("rotation", "drift"))
            ]
        )

    def _open_directions(self) -> np.ndarray:
        """(P, P - K) of all unknowns, in natural units, that are not observed: the free ones'
        beside those that are, and what all cameras share where one is held.
        """
        count, seen = self._seen.shape
        left = np.zeros((len(self._units), count - seen))
        left[self._free] = np.linalg.svd(self._seen)[0][:, seen:]
        unknowns = self._model.unknowns
        shared = [
            unknowns.vector(kind, unknowns.cameras, axis)
            for kind in ("rotation", "drift")
            if len(where := unknowns.where(kind, self.held)) and where[0] not in self._free
            for axis in np.eye(3)
        ]
        open_ = np.column_stack((*shared, left))
        return np.linalg.qr(open_)[0] if open_.shape[1] else open_

    def _information(
        self, equations: Sequence[SetEquations], weight: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Information (P, P) and right-hand side (P,), natural units."""
        size = len(self._units)
        information, right = np.zeros((size, size)), np.zeros(size)
        for each, w in zip(equations, weight, strict=True):
            design = each.design * self._units
            information += w * design.T @ design
            right += w * design.T @ each.residual
        return information, right

    def _step(
        self, equations: Sequence[SetEquations], weight: np.ndarray
    ) -> tuple[np.ndarray, float]:
        """Step (P,) along what is observed, and its squared length in sigmas."""
        information, right = self._information(equations, weight)
        values, seen = self._directions(information[np.ix_(self._free, self._free)])
        along = seen.T @ right[self._free] / values
        step = np.zeros(len(self._units))
        step[self._free] = (seen @ along) * self._units[self._free]
        return step, float(along @ (values * along))

    def _directions(self, information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Eigenvalues (K,) and directions (F, K) of the free unknowns that are observed."""
        if self._within is None:
            # Sets that share their errors count as one.
            return observed_directions(information, self._config.max_sigma / np.sqrt(self._alike))
        values, vectors = np.linalg.eigh(self._within.T @ information @ self._within)
        return values, self._within @ vectors

    def result(self, given: Sequence[FrameSet], nominal: Mapping[str, np.ndarray]) -> Calibration:
        """Return what was found. given : the sets with all that was measured."""
        sets = tuple(self._model.sets)
        unknowns, state = self._model.unknowns, self._state
        if len(self._values) == 0:
            reason = "the frame sets tell nothing of how the cameras are mounted"
            return Calibration.none(Status.ILL_CONDITIONED, reason, unknowns, nominal, sets)
        found = state.common.copy()
        for camera, rot in state.rot_base_from_cam.items():
            turned = vector_from_rotation(rot @ nominal[camera].T)
            found[unknowns.where("rotation", camera)] = turned
        share = np.zeros(len(unknowns))
        share[self._free] = np.einsum("ij,ij->i", self._seen, self._seen)
        return Calibration(
            Status.OK,
            "",
            unknowns,
            values=found,
            cov=self._covariance(),
            observed_share=share,
            not_observed=unobserved_in_words(
                unknowns,
                self._open_directions(),
                state.nadir_base,
                held=self.held,
                has_altitude=any(s.altitude is not None for s in given),
                has_reference=any(s.reference is not None for s in given),
            ),
            rot_base_from_cam=dict(state.rot_base_from_cam),
            sets=sets,
            used=self._weight > 0.0,
            nadir_base=state.nadir_base,
            scatter=self.scale,
            half_time_s=self._model.half_time_s,
            max_sigma=self._config.max_sigma,
        )

    def _covariance(self) -> np.ndarray:
        """(P, P) of the observed part, in the unknowns' own units."""
        out = np.zeros((len(self._units),) * 2)
        whole = self._seen @ self._covariance_within() @ self._seen.T
        out[np.ix_(self._free, self._free)] = whole
        return out * np.outer(self._units, self._units)

    def _covariance_within(self) -> np.ndarray:
        """(K, K) along what is observed, in natural units.

        The errors that limbs claim, propagated: those new in each frame; those that sets close
        in time share; and all that never changes, of these and of what is told. Enlarged where the
        sets' residuals say so: by their scatter and its correlation from set to set (Newey & West
        1987), pooled over what is observed.
        """
        size = len(self._free)
        claimed = np.zeros((size, size))
        steady = np.zeros((size, self._equations[0].steady.shape[1]))
        scores = []
        for each, w in zip(self._equations, self._weight, strict=True):
            design = w * (each.design * self._units)[:, self._free]
            shared = design.T @ each.shared
            claimed += design.T @ design + (self._alike - 1.0) * shared @ shared.T
            steady += design.T @ each.steady
            scores.append(design.T @ each.residual)
        gain = (self._seen / self._values).T
        cov = gain @ claimed @ gain.T
        always = gain @ steady
        shown = gain @ _long_run(np.array(scores)) @ gain.T
        factor = max(1.0, float(np.trace(np.linalg.solve(cov, shown))) / len(self._values))
        return np.asarray(factor * cov + always @ always.T)


def _weights(equations: Sequence[SetEquations]) -> tuple[np.ndarray, float]:
    """Tukey's weights (T,) of the sets, and the scale of their residuals.

    A scale below that claimed makes no set an outlier.
    """
    chi2 = np.array([each.chi2 for each in equations])
    freedom = np.array([each.freedom for each in equations])
    # Median of chi-squared (Wilson & Hilferty 1931).
    middle = freedom * (1.0 - 2.0 / (9.0 * freedom)) ** 3
    scale = float(np.sqrt(np.median(chi2 / middle)))
    limit = max(scale, 1.0) * (TUKEY_SIGMAS - 1.0 + np.sqrt(freedom))
    return np.maximum(1.0 - chi2 / limit**2, 0.0) ** 2, scale


def sets_alike(times_s: np.ndarray, correlation_s: float) -> float:
    """Return how many sets, of times (T,), there are to each whose shared errors are its own.

    correlation_s : time over which these stay alike; 0 where each set has its own.
    """
    if correlation_s == 0.0:
        return 1.0
    # From each set to the next, as a matrix of all pairs of a long recording would fill the memory.
    # Each pair is counted once by its later set.
    up_to = total = 1.0
    for share in np.exp(-np.diff(np.sort(times_s)) / correlation_s).tolist():
        up_to = 1.0 + share * up_to
        total += 2.0 * up_to - 1.0
    return total / len(times_s)


def _long_run(scores: np.ndarray) -> np.ndarray:
    """Covariance (K, K) of the sum of scores (T, K) whose neighbours may be correlated."""
    out = scores.T @ scores
    window = int(np.ceil(len(scores) ** (1.0 / 3.0)))
    for lag in range(1, window + 1):
        across = scores[lag:].T @ scores[:-lag]
        out += (1.0 - lag / (window + 1.0)) * (across + across.T)
    return out
