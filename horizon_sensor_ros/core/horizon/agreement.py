"""Whether the cameras of one fix say the same, each by itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from horizon_sensor_ros.core.covariance.calibration_error import with_calibration_error
from horizon_sensor_ros.core.fits.assessment import birge_factor, tangent_rows
from horizon_sensor_ros.core.fits.limb_rays import LimbRays
from horizon_sensor_ros.core.fits.maximum_likelihood import fit_maximum_likelihood
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.judgement import nadir_sigma_rad
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.planet import Planet

# Sigmas beyond which two cameras contradict each other. What single cameras claim holds to four
# sigma in plain scenes, to a little less in hard ones.
_CONTRADICTION = 4.0
_OF_ALTITUDE = 3.0  # sigmas between their altitudes beyond which all variances are enlarged
_HALVINGS = 30
_MOST_TURNED_RAD = math.pi
_STEPS, _CONVERGED = 10, 1e-3
_LEAST_SHARE = 1e-12  # of a covariance's largest variance; less is rounding


def each_alone(
    fit: HorizonFit,
    observations: Sequence[LimbObservation],
    sphere: Planet,
    with_errors: Callable[[HorizonFit, Sequence[LimbObservation]], HorizonFit],
) -> tuple[HorizonFit, ...]:
    """Fits of those cameras of a fit that determine a cone by themselves.

    with_errors : adds to the covariance of a fit what else may be wrong with its observations, as
    it was added to that of `fit`.
    """
    near = fit.nadir_base, fit.rho_rad
    alone = []
    for seen in observations:
        if seen.view.name in fit.cameras:
            found = fit_maximum_likelihood([seen], sphere, near)
            if found.ok:
                alone.append(with_errors(found, [seen]))
    return tuple(alone)


def with_contradiction(
    fit: HorizonFit,
    alone: Sequence[HorizonFit],
    observations: Sequence[LimbObservation],
    sphere: Planet,
) -> tuple[HorizonFit, str]:
    """Add to the covariance of a fit of several cameras what they contradict each other by.

    alone : one fit per camera, see `each_alone`. Returns the fit and the contradiction in words.
    The fit is unchanged and the words are empty where all agree within `_CONTRADICTION` sigmas, or
    where there are fewer than two.
    Nothing tells which camera is wrong. A difference in altitude, which no mounting explains,
    multiplies the covariance by its chi squared (`birge_factor`). What nadirs differ by beyond that
    is added as a mounting error of each camera.
    """
    pairs = [_Difference(pair, observations, sphere) for pair in combinations(alone, 2)]
    # The exact distance takes longer, and is hardly ever the larger one.
    pairs = [pair for pair in pairs if pair.linear_chi2() > _CONTRADICTION**2]
    worst = max(pairs, key=lambda pair: pair.chi2, default=None)
    if worst is None or not worst.chi2 > _CONTRADICTION**2:
        return fit, ""
    unlikely = worst.chi2_altitude() > _OF_ALTITUDE**2
    birge = birge_factor(worst.chi2_altitude(), 1) if unlikely else 1.0
    fit = replace(fit, cov_nadir_altitude=birge * fit.cov_nadir_altitude)
    turned_rad = worst.turned_rad(birge)
    # The rate's part is in the fit already.
    fit = with_calibration_error(
        fit, observations, sphere, mounting_sigma_rad=turned_rad, with_rate=False
    )
    return fit, worst.words()


@dataclass(frozen=True, eq=False)
class _Arc:
    """One camera's limb, by how far a cone lies off it at three places along it.

    In these three angles the errors are nearly Gaussian. In nadir and rho they are not: on a short
    arc they lie along a curve, beside which nadir is known a hundred times better, so that another
    estimate far along that curve looks like a contradiction.
    rays : at the three places. cov : (3, 3) of nadir's tangent components and rho of the fit.
    """

    fit: HorizonFit
    rays: LimbRays
    cov: np.ndarray

    @classmethod
    def of(cls, fit: HorizonFit, seen: Sequence[LimbObservation], sphere: Planet) -> _Arc:
        """Return that of a camera's fit by itself."""
        rays = next(each.rays for each in seen if each.view.name in fit.cameras)
        along = rays.along_limb(fit.nadir_base)
        last = len(along) - 1
        to_cone = tangent_rows(tangent_basis(fit.nadir_base))
        to_cone[2] /= sphere.altitude_slope(fit.rho_rad)
        return cls(
            fit,
            rays.take(along[[last // 6, last // 2, last - last // 6]]),
            to_cone @ fit.cov_nadir_altitude @ to_cone.T,
        )

    def off(self, nadir: np.ndarray, rho_rad: float) -> np.ndarray:
        """Angles (3,) from the cone's limb out to the directions."""
        return self.rays.angles(nadir)[0] - rho_rad

    def slopes(self, nadir: np.ndarray) -> np.ndarray:
        """Derivative (3, 3) of `off` by nadir's tangent components and rho."""
        return self.rays.design(nadir, tangent_basis(nadir))

    def whitening(self) -> np.ndarray:
        """Matrix (3, 3) that whitens what `off` differs by from the fit's own."""
        slopes = self.slopes(self.fit.nadir_base)
        variance, axes = np.linalg.eigh(slopes @ self.cov @ slopes.T)
        return np.asarray(axes / np.sqrt(np.maximum(variance, _LEAST_SHARE * variance[-1]))).T


@dataclass(frozen=True, eq=False)
class _Difference:
    """What separates two cameras' estimates, each by itself, of these limbs of a sphere."""

    fits: tuple[HorizonFit, HorizonFit]
    seen: Sequence[LimbObservation]
    sphere: Planet

    @cached_property
    def value(self) -> np.ndarray:
        """Difference (3,): by how much two components of nadir, and altitude, differ."""
        one, other = self.fits
        nadir = other.nadir_base - one.nadir_base
        return self._to_tangent @ np.append(nadir, other.altitude_m - one.altitude_m)

    @cached_property
    def cov(self) -> np.ndarray:
        """Covariance (3, 3) of that."""
        one, other = (fit.cov_nadir_altitude for fit in self.fits)
        return np.asarray(self._to_tangent @ (one + other) @ self._to_tangent.T)

    @cached_property
    def _to_tangent(self) -> np.ndarray:
        return tangent_rows(tangent_basis(self.fits[0].nadir_base))

    def linear_chi2(self, turned_rad: float = 0.0, times: float = 1.0) -> float:
        """Chi squared of the difference by the covariances of nadir and altitude.

        times : factor that enlarges these. turned_rad : one sigma of each camera's mounting.
        """
        cov = times * self.cov + 2.0 * turned_rad**2 * np.diag([1.0, 1.0, 0.0])
        chi2 = float(self.value @ np.linalg.solve(cov, self.value))
        return chi2 if chi2 < math.inf else 0.0

    @cached_property
    def chi2(self) -> float:
        """Square of the distance in sigmas of both limbs from the cone that is nearest to both."""
        arcs = [_Arc.of(fit, self.seen, self.sphere) for fit in self.fits]
        whiten = [arc.whitening() for arc in arcs]
        own = [arc.off(arc.fit.nadir_base, arc.fit.rho_rad) for arc in arcs]
        # Start from the camera that knows nadir better.
        start = min(self.fits, key=nadir_sigma_rad)
        nadir, rho = start.nadir_base, start.rho_rad
        best = math.inf
        for _ in range(_STEPS):
            seen = zip(whiten, own, arcs, strict=True)
            off = np.concatenate([w @ (arc.off(nadir, rho) - o) for w, o, arc in seen])
            chi2 = float(off @ off)
            if not chi2 < (1.0 - _CONVERGED) * best:
                break
            best = chi2
            pairs = zip(whiten, arcs, strict=True)
            slopes = np.concatenate([w @ arc.slopes(nadir) for w, arc in pairs])
            step = np.linalg.lstsq(slopes, -off, rcond=None)[0]
            nadir = nadir + tangent_basis(nadir) @ step[:2]
            nadir /= np.linalg.norm(nadir)
            rho += float(step[2])
        return best if best < math.inf else 0.0

    def chi2_altitude(self) -> float:
        """Chi squared of the difference of the altitudes alone."""
        return float(self.value[2] ** 2 / self.cov[2, 2])

    def words(self) -> str:
        """Return the contradiction for a person."""
        names = " and ".join(name for fit in self.fits for name in fit.cameras)
        nadir_deg = math.degrees(math.hypot(*self.value[:2]))
        return (
            f"{names}, each by itself, are {math.sqrt(self.chi2):.0f} sigma apart "
            f"(nadir {nadir_deg:.2f} deg, altitude {abs(self.value[2]) / 1e3:.1f} km): "
            "are they mounted and calibrated as the parameters say?"
        )

    def turned_rad(self, times: float) -> float:
        """By how much cameras must be turned, one sigma, to see nadir as far apart as they do, if
        covariances are `times` as large.
        """
        expected = 2.0 + self.chi2_altitude() / times
        low, high = 0.0, _MOST_TURNED_RAD
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (
                (middle, high) if self.linear_chi2(middle, times) > expected else (low, middle)
            )
            if high - low < 1e-3 * high:
                break
        return high
