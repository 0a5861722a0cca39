"""Fits: limb points of any number of cameras -> nadir, disc radius, altitude.

In: ``observation``, ``limb_rays``; out: ``result``. Methods: ``maximum_likelihood`` (the default);
the papers' ``chord``, ``arc`` and ``gauss_newton``; ``cone`` and, to start from, ``circle``. Around
them: ``assessment`` (covariance, and whether to trust it), ``bound`` (what none can beat),
``known_altitude`` and ``moved`` (joined with what else is known), ``disc`` (drawn in the frames).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

from horizon_sensor_ros.core.fits.arc import fit_arc
from horizon_sensor_ros.core.fits.chord import fit_chord, fit_chord_image
from horizon_sensor_ros.core.fits.cone import fit_cone
from horizon_sensor_ros.core.fits.gauss_newton import fit_gauss_newton
from horizon_sensor_ros.core.fits.maximum_likelihood import fit_maximum_likelihood
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.planet import Planet

METHODS: Mapping[str, Callable[[Sequence[LimbObservation], Planet], HorizonFit]] = MappingProxyType(
    {
        "chord": fit_chord,
        "chord_image": fit_chord_image,
        "arc": fit_arc,
        "gauss_newton": fit_gauss_newton,
        "cone": fit_cone,
        "ml": fit_maximum_likelihood,
    }
)


def fit_horizon(
    observations: Sequence[LimbObservation], planet: Planet, method: str = "ml"
) -> HorizonFit:
    """Fit a horizon with one of `METHODS`; the default is the most accurate.

    Bad or too few points never raise: the result's status is not OK and its estimates are NaN.
    Raises ValueError for an unknown method.
    """
    if method not in METHODS:
        raise ValueError(f"unknown method {method!r}; known are {', '.join(METHODS)}")
    return METHODS[method](observations, planet)
