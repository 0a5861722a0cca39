"""The residuals of all frame sets and their information on what the sets have in common.

With t from -1 to 1 over the recording, ``exp`` of a rotation vector in the base frame, a camera's
horizon is predicted as ``nadir_cam = (exp(t drift) exp(misalignment) R_nominal)^T nadir_base`` and
the rho that all cameras share. Nadir and rho of each set are nuisances; the Schur complement takes
them out of the normal equations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from horizon_sensor_ros.core.aiding import AltitudeMeasurement
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.mathematics.rigid import rotation_from_vector, skew
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.self_calibration.measurement import (
    CameraHorizon,
    FrameSet,
    NadirReference,
)
from horizon_sensor_ros.core.self_calibration.unknowns import Unknowns

# Columns of `_Rows.steady` at its end, of what is not a camera's.
_OF_OTHERS = 4
_OF_ALTITUDE, _OF_REFERENCE = -4, slice(-3, None)


@dataclass(frozen=True, eq=False)
class State:
    """What is believed of everything.

    rot_base_from_cam : without drift, by camera. common : (P,) drifts, focal scales less one and
    limb height as in `Unknowns`; its rotations are those turned by since the start, to first order.
    nadir_base : (T, 3); rho_rad : (T,), of each set.
    """

    rot_base_from_cam: Mapping[str, np.ndarray]
    common: np.ndarray
    nadir_base: np.ndarray
    rho_rad: np.ndarray


class _Rows(NamedTuple):
    """Whitened equations: residual (R,), its derivatives by nuisances (R, 3) and unknowns (R, P).

    shared (R, 3 C) : what one sigma of the errors that frames share makes of each camera; steady
    (R, S) : of all that never changes.
    """

    residual: np.ndarray
    nuisance: np.ndarray
    common: np.ndarray
    shared: np.ndarray
    steady: np.ndarray


@dataclass(frozen=True, eq=False)
class SetEquations:
    """One set's whitened equations, its nuisances eliminated.

    design : (R, P), residual : (R,) to be matched by ``design @ step``; both are what is left of
    them outside the nuisances' columns. shared : (R, 3 C), a camera's three columns being the
    square root of the covariance of those of its errors that frames share, along axes fixed to it;
    the rest of the unit covariance is new in each set. steady : (R, S) one sigma each of what never
    changes: six a camera (a part of what frames share, and what is told of lens and figure), the
    altitude's error, and three of the reference's. freedom : R less three.
    back : (3,) and back_design : (3, P) give the nuisances' step ``back - back_design @ step``.
    """

    design: np.ndarray
    residual: np.ndarray
    shared: np.ndarray
    steady: np.ndarray
    freedom: int
    back: np.ndarray
    back_design: np.ndarray

    @property
    def chi2(self) -> float:
        """Sum of squared residuals after the nuisances are fitted."""
        return float(self.residual @ self.residual)


class Model:
    """Frame sets, the planet, and the unknowns that they are to tell."""

    def __init__(self, sets: Sequence[FrameSet], planet: Planet, unknowns: Unknowns) -> None:
        self.sets = sets
        self.unknowns = unknowns
        self._planet = planet
        times = np.array([s.time_s for s in sets])
        middle, half = (times.max() + times.min()) / 2, (times.max() - times.min()) / 2
        self.half_time_s = float(half)
        self._phase = (times - middle) / half if half > 0 else np.zeros(len(times))
        self._whitened = {
            (index, h.camera): self._whitening(h)
            for index, s in enumerate(sets)
            for h in s.horizons
        }
        where = unknowns.where
        self._rotation = {c: where("rotation", c) for c in unknowns.cameras}
        self._drift = {c: where("drift", c) for c in unknowns.cameras}
        self._focal = {c: where("focal", c) for c in unknowns.cameras}
        self._limb_height = int(where("limb_height")[0])

    def start(self, rot_base_from_cam: Mapping[str, np.ndarray]) -> State:
        """State with nothing to correct: each set's nadir and rho as its first camera saw them.

        rot_base_from_cam : (3, 3) by camera.
        """
        first = [s.horizons[0] for s in self.sets]
        nadir = [rot_base_from_cam[h.camera] @ h.nadir_cam for h in first]
        rho = [h.rho_rad for h in first]
        return State(
            dict(rot_base_from_cam), np.zeros(len(self.unknowns)), np.array(nadir), np.array(rho)
        )

    def equations(self, state: State, index: int) -> SetEquations:
        """Return a set's equations about the state."""
        frames = self.sets[index]
        nadir, rho = state.nadir_base[index], float(state.rho_rad[index])
        basis = tangent_basis(nadir)
        parts = [self._horizon_rows(state, index, basis, h) for h in frames.horizons]
        if frames.reference is not None:
            parts.append(self._reference_rows(nadir, basis, frames.reference))
        if frames.altitude is not None:
            parts.append(self._altitude_row(state, rho, frames.altitude))
        rows = _Rows(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
        u, s, vt = np.linalg.svd(rows.nuisance, full_matrices=False)
        inverse = (vt.T / s) @ u.T
        reduced = np.eye(len(u)) - u @ u.T
        return SetEquations(
            design=reduced @ rows.common,
            residual=reduced @ rows.residual,
            shared=rows.shared,
            steady=rows.steady,
            freedom=len(u) - 3,
            back=inverse @ rows.residual,
            back_design=inverse @ rows.common,
        )

    def stepped(self, state: State, step: np.ndarray, equations: Sequence[SetEquations]) -> State:
        """Return the state after a step (P,) of the unknowns, each set's nuisances following."""
        rotations = {
            camera: rotation_from_vector(step[self._rotation[camera]]) @ rot
            for camera, rot in state.rot_base_from_cam.items()
        }
        own = np.array([e.back - e.back_design @ step for e in equations])
        nadir = np.array(
            [n + tangent_basis(n) @ d for n, d in zip(state.nadir_base, own[:, :2], strict=True)]
        )
        nadir /= np.linalg.norm(nadir, axis=1, keepdims=True)
        rho = np.clip(state.rho_rad + own[:, 2], 1e-6, np.pi / 2)
        return State(rotations, state.common + step, nadir, rho)

    def _horizon_rows(
        self, state: State, index: int, basis: np.ndarray, horizon: CameraHorizon
    ) -> _Rows:
        nadir, phase = state.nadir_base[index], self._phase[index]
        camera = horizon.camera
        measured = tangent_basis(horizon.nadir_cam)
        offset = np.zeros(3)
        common = np.zeros((3, len(self.unknowns)))
        to_cam = state.rot_base_from_cam[camera].T
        if self.unknowns.drift:
            drift = phase * state.common[self._drift[camera]]
            to_cam = to_cam @ rotation_from_vector(drift).T
        # A turn e of the camera: exp(e)^T nadir = nadir + nadir x e.
        turned = measured.T @ to_cam @ skew(nadir)
        common[:2, self._rotation[camera]] = turned
        if self.unknowns.drift:
            common[:2, self._drift[camera]] = phase * turned
        if self.unknowns.focal:
            (focal,) = self._focal[camera]
            offset = horizon.focal_slope * state.common[focal]
            common[:, focal] = -horizon.focal_slope
        residual = offset + np.append(
            -measured.T @ (to_cam @ nadir), horizon.rho_rad - state.rho_rad[index]
        )
        nuisance = np.zeros((3, 3))
        nuisance[:2, :2] = measured.T @ to_cam @ basis
        nuisance[2, 2] = 1.0
        whiten, shared, steady = self._whitened[index, camera]
        return _Rows(whiten @ residual, whiten @ nuisance, whiten @ common, shared, steady)

    def _whitening(self, horizon: CameraHorizon) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Matrix (3, 3) that whitens a horizon's residual, and whitened `_Rows.shared` and `steady`
        (3, 3 C) and (3, S).
        """
        cov = horizon.cov_noise + horizon.cov_shared + horizon.cov_steady
        whiten = np.linalg.inv(np.linalg.cholesky(cov))
        shared, steady = self._none_shared(3)
        at = 3 * self.unknowns.cameras.index(horizon.camera)
        root = whiten @ _square_root(horizon.cov_shared, horizon.nadir_cam)
        shared[:, at : at + 3] = root
        steady[:, 2 * at : 2 * at + 3] = horizon.steady_share * root
        steady_root = whiten @ _square_root(horizon.cov_steady, horizon.nadir_cam)
        steady[:, 2 * at + 3 : 2 * at + 6] = steady_root
        return whiten, shared, steady

    def _reference_rows(
        self, nadir: np.ndarray, basis: np.ndarray, reference: NadirReference
    ) -> _Rows:
        across = tangent_basis(reference.nadir_base).T / reference.sigma_rad
        nuisance = np.column_stack((across @ basis, np.zeros(2)))
        shared, steady = self._none_shared(2)
        steady[:, _OF_REFERENCE] = -reference.sigma_rad * across @ skew(nadir)
        common = np.zeros((2, len(self.unknowns)))
        return _Rows(-across @ nadir, nuisance, common, shared, steady)

    def _altitude_row(self, state: State, rho: float, altitude: AltitudeMeasurement) -> _Rows:
        planet = self._planet
        limb_radius = planet.limb_radius_m + state.common[self._limb_height]
        predicted = limb_radius / np.sin(rho) - planet.mean_radius_m
        slope = planet.altitude_slope(rho) * limb_radius / planet.limb_radius_m
        common = np.zeros((1, len(self.unknowns)))
        common[0, self._limb_height] = 1.0 / np.sin(rho) / altitude.sigma_m
        shared, steady = self._none_shared(1)
        steady[0, _OF_ALTITUDE] = 1.0
        return _Rows(
            np.array([(altitude.altitude_m - predicted) / altitude.sigma_m]),
            np.array([[0.0, 0.0, slope / altitude.sigma_m]]),
            common,
            shared,
            steady,
        )

    def _none_shared(self, rows: int) -> tuple[np.ndarray, np.ndarray]:
        """`_Rows.shared` and `steady` of so many rows that nothing is known of."""
        cameras = len(self.unknowns.cameras)
        return np.zeros((rows, 3 * cameras)), np.zeros((rows, 6 * cameras + _OF_OTHERS))


def _square_root(cov: np.ndarray, nadir: np.ndarray) -> np.ndarray:
    """Root (3, 3) of a covariance; columns: sideways, towards the camera's axis, rho.

    Rows are along ``tangent_basis(nadir)``, which is not fixed to the camera, and rho. nadir : (3,)
    in the optical frame.
    """
    forward = np.array([0.0, 0.0, 1.0]) - nadir[2] * nadir
    if np.linalg.norm(forward) < 1e-6:  # it looks straight down: any direction will do
        forward = np.array([0.0, 1.0, 0.0])
    forward /= np.linalg.norm(forward)
    turn = np.eye(3)
    turn[:2, :2] = tangent_basis(nadir).T @ np.column_stack((np.cross(nadir, forward), forward))
    values, vectors = np.linalg.eigh(turn.T @ cov @ turn)
    return turn @ (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
