"""What an error of the planet's figure does to a fit of its limb, for any arcs of it.

To first order in the flattening the ellipsoid enters through the symmetric matrix ``K = k k^T`` of
its axis k alone: rays are stretched by ``1 + eps K``. So whatever is wrong about the axis moves
nadir and altitude by a linear map of K's error, and its covariance follows from K's.
Derived here. Symmetric matrices are six numbers, (11, 22, 33, 12, 13, 23), in the axes (two
tangents at nadir, nadir).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from horizon_sensor_ros.core.covariance.common_cone import cone_shares
from horizon_sensor_ros.core.fits.observation import LimbObservation, gather
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.mathematics.rigid import rotation_from_vector
from horizon_sensor_ros.core.planet import Planet

_POINTS = 100  # of a camera's limb, at most; the influence needs no more
_OUTLIER_PX = 5.0

# Covariance of K over all directions of k, about its mean, the unit matrix over three: fourth
# moments of a unit vector are (d_ij d_kl + d_ik d_jl + d_il d_jk) / 15.
ANY_POLE = np.diag([4 / 45] * 3 + [1 / 15] * 3)
ANY_POLE[:3, :3] -= np.full((3, 3), 2 / 45) - np.diag([2 / 45] * 3)

# A normal distribution by points: mean values of sines and cosines of up to four times an angle, of
# a sigma of up to pi, are right to 1e-8.
_NORMAL_AT = np.arange(-19, 20) * 0.32
_NORMAL_WEIGHT = np.exp(-0.5 * _NORMAL_AT**2)
_NORMAL_WEIGHT /= _NORMAL_WEIGHT.sum()


def figure_influence(
    fit: HorizonFit, observations: Sequence[LimbObservation], planet: Planet, vertical: str
) -> np.ndarray:
    """(3, 6): how nadir's two tangent components, rad, and the altitude, m, answer to K.

    fit : of the sphere that stands for the planet, to these observations' limbs, weighted as the
    maximum-likelihood fit does, or as cones. vertical : the published one, geocentric or geodetic.
    """
    shares = cone_shares(fit, observations)
    if shares:
        moved = sum((share @ _moved(fit, [one]) for one, share in shares), np.zeros((3, 6)))
    else:
        moved = _moved(fit, [one for one in observations if one.view.name in fit.cameras])
    # Bringing the position back, and from it to the vertical.
    distance = planet.mean_radius_m + fit.altitude_m
    tilt = 2.0 * planet.mean_radius_m / distance - 1.0 if vertical == "geodetic" else -1.0
    moved[2] *= planet.altitude_slope(fit.rho_rad)
    moved[0, 4] += tilt
    moved[1, 5] += tilt
    moved[2, 2] -= fit.altitude_m
    equator = planet.radius_m + planet.limb_height_m
    return (equator / (planet.polar_radius_m + planet.limb_height_m) - 1.0) * moved


def _moved(fit: HorizonFit, observations: Sequence[LimbObservation]) -> np.ndarray:
    """(3, 6): how nadir's tangent components and rho that fit these limbs answer to K."""
    rays = gather([_thinned(one) for one in observations])
    axes = np.column_stack((tangent_basis(fit.nadir_base), fit.nadir_base))
    theta, growth = rays.angles(fit.nadir_base)
    near = np.abs(theta - fit.rho_rad) < _OUTLIER_PX * growth
    weight = np.where(near, 1.0 / (growth * rays.sigma_px) ** 2, 0.0)
    u1, u2, u3 = (rays.rays_base @ axes).T
    sine = np.sqrt(np.maximum(1.0 - u3 * u3, 1e-300))
    design = np.column_stack((-u1 / sine, -u2 / sine, np.full_like(u1, -1.0)))
    # Angle from nadir gained by stretching: -(n^T K u - cos theta u^T K u) / sin theta.
    twice = 1.0 - 2.0 * u3 * u3
    gained = np.array(
        [
            u3 * u1 * u1,
            u3 * u2 * u2,
            -u3 * sine * sine,
            2.0 * u3 * u1 * u2,
            -u1 * twice,
            -u2 * twice,
        ]
    ).T
    gained /= sine[:, None]
    weighted = design * weight[:, None]
    # A ray that seems farther out by `gained` moves nadir and rho by as much as fits it again.
    fitted = np.linalg.pinv(weighted.T @ design, hermitian=True)
    return np.asarray(-fitted @ (weighted.T @ gained))


def _thinned(observation: LimbObservation) -> LimbObservation:
    """Every so many-th point; each stands for as many others."""
    limb = observation.limb
    step = 1 + (len(limb.px) - 1) // _POINTS
    part = LimbPoints(
        limb.status,
        limb.reason,
        limb.px[::step],
        limb.normal_px[::step],
        limb.sigma_px[::step] / np.sqrt(step),
    )
    return LimbObservation(observation.view, part)


def mean_figure(nadir_base: np.ndarray, pole_base: np.ndarray, heading_rad: float) -> np.ndarray:
    """(3, 3), mean of K in the base frame where the pole's heading about nadir has one sigma.

    Of a normal law's angle the mean cosine of m times it is exp(-m^2 sigma^2 / 2).
    """
    once, twice = np.exp(-0.5 * heading_rad**2), np.exp(-2.0 * heading_rad**2)
    along = nadir_base * (nadir_base @ pole_base)
    across = pole_base - along
    around = np.eye(3) - np.outer(nadir_base, nadir_base)
    mixed = np.outer(along, across)
    return np.asarray(
        np.outer(along, along)
        + once * (mixed + mixed.T)
        + twice * np.outer(across, across)
        + 0.5 * (1.0 - twice) * (across @ across) * around
    )


def pole_covariance(
    nadir_base: np.ndarray,
    pole_base: np.ndarray,
    position_rad: float,
    heading_rad: float,
    mean_heading_rad: float = 0.0,
) -> np.ndarray:
    """(6, 6) of K from one sigma of the position, as an angle each way, and of the heading.

    mean_heading_rad : one sigma of the headings that K was taken to be the mean of (`mean_figure`);
    0, the default: it was taken to be that of pole_base.
    """
    axes = np.column_stack((tangent_basis(nadir_base), nadir_base))
    k = pole_base @ axes
    # A heading of which nothing is known is any: K turns with twice the angle, its square with four
    # times, and three points would see half of that or none.
    angle = np.minimum((position_rad, position_rad, heading_rad), np.pi)
    turns = (_NORMAL_AT[:, None, None] * np.diag(angle)).reshape(-1, 3)
    turned = (rotation_from_vector(turns) @ k).reshape(-1, 3, 3)
    i, j = np.array([0, 1, 2, 0, 0, 1]), np.array([0, 1, 2, 1, 2, 2])
    rows = turned[..., i] * turned[..., j]
    rows[:, :2] -= k[i] * k[j]
    rows[:, 2] -= (axes.T @ mean_figure(nadir_base, pole_base, mean_heading_rad) @ axes)[i, j]
    rows *= np.sqrt(_NORMAL_WEIGHT)[:, None, None]
    rows = rows.reshape(-1, 6)
    return rows.T @ rows


def figure_covariance(fit: HorizonFit, influence: np.ndarray, of_pole: np.ndarray) -> np.ndarray:
    """(4, 4) of (nadir_base, altitude_m) from the influence (3, 6) and K's covariance (6, 6)."""
    to_fit = np.zeros((4, 3))
    to_fit[:3, :2] = tangent_basis(fit.nadir_base)
    to_fit[3, 2] = 1.0
    out = to_fit @ influence
    return out @ of_pole @ out.T
