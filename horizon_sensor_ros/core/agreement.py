"""Whether the cameras of one fix say the same, each by itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from horizon_sensor_ros.core.attitude import tangent_basis
from horizon_sensor_ros.core.calibration_error import with_calibration_error
from horizon_sensor_ros.core.fits.assessment import tangent_rows
from horizon_sensor_ros.core.fits.maximum_likelihood import fit_maximum_likelihood
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.planet import Planet

# Sigmas from which on two cameras contradict each other: what they claim each by itself holds to
# four in plain scenes, a little less in hard ones.
_CONTRADICTION = 4.0
_OF_ALTITUDE = 3.0  # the same of their altitudes, from which on these are enlarged for as well
_HALVINGS = 30
_MOST_TURNED_RAD = math.pi


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
    """Return the fit of several cameras with what they contradict each other by in its covariance,
    and that in words; none where they agree.

    alone : of each camera, as of `each_alone`. Unchanged where they agree within `_CONTRADICTION`
    sigmas, or where there are not two.
    Nothing tells which camera is wrong. What altitudes are apart by is no mounting's, and enlarges
    the covariance by its chi squared (Birge, Phys. Rev. 40 (1932) 207). They are taken to be
    mounted as badly as explains what nadir is apart by beyond that.
    """
    pairs = [_Apart.of(one, other) for one, other in combinations(alone, 2)]
    worst = max(pairs, key=_Apart.chi2, default=None)
    if worst is None or not worst.chi2() > _CONTRADICTION**2:
        return fit, ""
    birge = worst.chi2_altitude() if worst.chi2_altitude() > _OF_ALTITUDE**2 else 1.0
    fit = replace(fit, cov_nadir_altitude=birge * fit.cov_nadir_altitude)
    turned_rad = replace(worst, cov=birge * worst.cov).turned_rad()
    fit = with_calibration_error(fit, observations, sphere, mounting_sigma_rad=turned_rad)
    return fit, worst.words()


@dataclass(frozen=True, eq=False)
class _Apart:
    """What two cameras' estimates differ by: (3,) two components of nadir, and altitude; and the
    covariance (3, 3) of that.
    """

    cameras: tuple[str, ...]
    apart: np.ndarray
    cov: np.ndarray

    @classmethod
    def of(cls, one: HorizonFit, other: HorizonFit) -> _Apart:
        """Return what separates two fits."""
        to_tangent = tangent_rows(tangent_basis(one.nadir_base))
        nadir = other.nadir_base - one.nadir_base
        return cls(
            one.cameras + other.cameras,
            to_tangent @ np.append(nadir, other.altitude_m - one.altitude_m),
            to_tangent @ (one.cov_nadir_altitude + other.cov_nadir_altitude) @ to_tangent.T,
        )

    def chi2(self, turned_rad: float = 0.0) -> float:
        """Square of the distance in sigmas, if each camera is turned by so much, one sigma."""
        cov = self.cov + 2.0 * turned_rad**2 * np.diag([1.0, 1.0, 0.0])
        chi2 = float(self.apart @ np.linalg.solve(cov, self.apart))
        return chi2 if chi2 < math.inf else 0.0

    def chi2_altitude(self) -> float:
        """The same of the altitudes alone."""
        return float(self.apart[2] ** 2 / self.cov[2, 2])

    def words(self) -> str:
        """Return the contradiction for a person."""
        names = " and ".join(self.cameras)
        nadir_deg = math.degrees(math.hypot(*self.apart[:2]))
        return (
            f"{names}, each by itself, are {math.sqrt(self.chi2()):.0f} sigma apart "
            f"(nadir {nadir_deg:.2f} deg, altitude {abs(self.apart[2]) / 1e3:.1f} km): "
            "are they mounted and calibrated as the parameters say?"
        )

    def turned_rad(self) -> float:
        """By how much cameras must be turned, one sigma, to see nadir as far apart as they do."""
        expected = 2.0 + self.chi2_altitude()
        low, high = 0.0, _MOST_TURNED_RAD
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.chi2(middle) > expected else (low, middle)
            if high - low < 1e-3 * high:
                break
        return high
