"""The planet's figure as the chain fits it: always a sphere.

Stretched along its axis by the ratio of its semi-axes, an ellipsoid of revolution becomes a sphere,
straight lines stay straight, and rays that graze the one graze the other. So with the axis known
in the base frame (a coarse pose) the cameras' rays are stretched, the limb is found and fitted as a
sphere's, exactly, and the result is brought back. Where its heading is hardly known they are
stretched by the mean over all headings, to first order in the flattening. Without an axis the mean
sphere is fitted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from horizon_sensor_ros.core.aiding import CoarsePose
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.cameras.stretched_camera import stretched_view
from horizon_sensor_ros.core.covariance.figure_error import (
    ANY_POLE,
    figure_covariance,
    figure_influence,
    mean_figure,
    pole_covariance,
)
from horizon_sensor_ros.core.fits.disc import Disc
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.mathematics.attitude import angle_rad
from horizon_sensor_ros.core.mathematics.rigid import skew
from horizon_sensor_ros.core.motion.turn_rate import TurnRate
from horizon_sensor_ros.core.planet import Planet

VERTICALS = ("geocentric", "geodetic")
# A coarse attitude farther off the measured vertical than this many of its sigmas is none.
_CONTRADICTION_SIGMAS = 5.0
# A heading better than this is taken as it is told: the mean over such ones would be a twentieth
# better, and worse where poses are better than they are told to be.
_HARDLY_KNOWN_RAD = 0.5
_STANDS_STILL = TurnRate(np.zeros(3), 0.0)


class Figure(Protocol):
    """What stands for the planet while a set of frames is processed.

    sphere : the body that is fitted, `mean_sphere` of the planet.
    """

    @property
    def sphere(self) -> Planet:
        """The sphere that is fitted."""

    @property
    def shortfall(self) -> str:
        """Why it is not the planet's own figure; empty when it is."""

    def view(self, view: CameraView) -> CameraView:
        """Return a camera as it sees that sphere."""

    def aligned(self, nadir_base: np.ndarray) -> Figure:
        """Return the figure with its axis where a first fit of that sphere, nadir (3,), puts it."""

    def covariance(self, fit: HorizonFit, observations: Sequence[LimbObservation]) -> np.ndarray:
        """(4, 4) of (nadir, altitude): error of a fit that the figure's own error makes."""

    def estimate(self, fit: HorizonFit) -> HorizonFit:
        """Return a fit of that sphere as nadir and altitude of the planet."""


def mean_sphere(planet: Planet) -> Planet:
    """Sphere of the planet's mean radius, the planet itself if it is one."""
    if planet.flattening == 0.0:
        return planet
    return replace(planet, radius_m=planet.mean_radius_m, flattening=0.0)


def disc_of(fit: HorizonFit) -> Disc:
    """Return the fit's disc; if the fit does not carry one, that of a sphere with its nadir and
    rho.
    """
    sphere = MeanSphere(Planet(), VERTICALS[0])
    return fit.disc or Disc(sphere, fit.nadir_base, fit.rho_rad)


class MeanSphere:
    """A sphere, or an ellipsoid of which nobody knows how its axis lies.

    vertical : the one whose error the covariance is of, geocentric or geodetic. why : of an
    ellipsoid, why it is taken for a sphere.
    """

    def __init__(self, planet: Planet, vertical: str, why: str = "no coarse pose") -> None:
        self._planet = planet
        self._vertical = vertical
        self.sphere = mean_sphere(planet)
        self.shortfall = f"fitted as a sphere: {why}" if planet.flattening > 0.0 else ""

    def view(self, view: CameraView) -> CameraView:
        """Return the camera as it is."""
        return view

    def aligned(self, nadir_base: np.ndarray) -> Figure:
        """Return itself: a sphere lies any way."""
        del nadir_base
        return self

    def covariance(self, fit: HorizonFit, observations: Sequence[LimbObservation]) -> np.ndarray:
        """(4, 4), error of taking the ellipsoid for a sphere, over all ways in which it may lie."""
        if self._planet.flattening == 0.0:
            return np.zeros((4, 4))
        influence = figure_influence(fit, observations, self._planet, self._vertical)
        return figure_covariance(fit, influence, ANY_POLE)

    def estimate(self, fit: HorizonFit) -> HorizonFit:
        """Return the fit with its disc."""
        return replace(fit, disc=Disc(self, fit.nadir_base, fit.rho_rad))


class StretchedEllipsoid:
    """An ellipsoid whose axis a coarse pose gives, stretched to a sphere of its mean limb.

    Where the heading is hardly known it is the mean of the ellipsoids of all headings: to first
    order in the flattening its limb is the mean of theirs.
    nadir_base, pole_base : (3,) unit vectors, the latter along the axis; by default as the pose has
    them. heading_sigma_rad : what the heading is off by, where that is more than the pose claims.
    rate : at which the craft has turned since the time of the pose.
    """

    def __init__(
        self,
        planet: Planet,
        vertical: str,
        pose: CoarsePose,
        nadir_base: np.ndarray | None = None,
        pole_base: np.ndarray | None = None,
        heading_sigma_rad: float = 0.0,
        rate: TurnRate = _STANDS_STILL,
    ) -> None:
        self._planet = planet
        self._vertical = vertical
        self._pose = pose
        self._rate = rate
        nadir = -_up(pose) if nadir_base is None else nadir_base
        self._pole = pose.rot_ecef_from_base[2] if pole_base is None else pole_base
        # Turns about other axes are seen: `aligned` measures them.
        turned = pose.age_s * math.hypot(float(rate.rate_base_rad_s @ nadir), rate.sigma_rad_s)
        self._heading_sigma = math.hypot(max(heading_sigma_rad, pose.rotation_sigma_rad), turned)
        hardly_known = self._heading_sigma > _HARDLY_KNOWN_RAD
        self._mean_heading = self._heading_sigma if hardly_known else 0.0
        self.sphere = mean_sphere(planet)
        self.shortfall = ""
        equator = planet.radius_m + planet.limb_height_m
        ratio = equator / (planet.polar_radius_m + planet.limb_height_m)
        mean = mean_figure(nadir, self._pole, self._mean_heading)
        self._stretch = np.eye(3) + (ratio - 1.0) * mean
        self._inverse = np.linalg.inv(self._stretch)
        # So that the limb gets the mean sphere's radius.
        self._scale = self.sphere.limb_radius_m / equator
        self._views: dict[int, tuple[CameraView, CameraView]] = {}

    def view(self, view: CameraView) -> CameraView:
        """Return the camera with its rays stretched along the planet's axis."""
        # Asked for a few times a set. Beside its own view, so that no other one gets its id.
        kept = self._views.get(id(view))
        if kept is None:
            kept = self._views[id(view)] = (view, stretched_view(view, self._stretch))
        return kept[1]

    def aligned(self, nadir_base: np.ndarray) -> Figure:
        """Return the figure turned, by the shortest way, to the vertical that was measured.

        What is left of the coarse attitude is the heading. Where it contradicts the vertical, by
        more than the craft may have turned since, it is not believed, and the mean sphere is
        returned. Before that an attitude that is far off the vertical is taken to be as far off
        about it: of a turn about any axis two components show.
        """
        up = self._inverse @ -nadir_base
        up /= np.linalg.norm(up)
        coarse_up = _up(self._pose)
        off = angle_rad(coarse_up, up)
        age = self._pose.age_s
        turned = age * float(np.linalg.norm(self._rate.rate_base_rad_s))
        sigma = math.hypot(
            self._pose.rotation_sigma_rad,
            self._pose.position_sigma_rad(self._planet),
            age * self._rate.sigma_rad_s,
        )
        if off > min(_CONTRADICTION_SIGMAS * sigma + turned + 1e-3, 0.9 * np.pi):
            why = f"the coarse pose is {np.degrees(off):.0f} deg off the limb's vertical"
            return MeanSphere(self._planet, self._vertical, why)
        pole = _shortest_rotation(coarse_up, up) @ self._pose.rot_ecef_from_base[2]
        about = off * math.sqrt(0.5)
        return StretchedEllipsoid(
            self._planet, self._vertical, self._pose, -up, pole, about, self._rate
        )

    def covariance(self, fit: HorizonFit, observations: Sequence[LimbObservation]) -> np.ndarray:
        """(4, 4), error that the pose's leaves: its position's in latitude, its attitude's in
        heading, and what the craft has moved and turned by since.
        """
        influence = figure_influence(fit, observations, self._planet, self._vertical)
        position = self._pose.position_sigma_rad(self._planet)
        of_pole = pole_covariance(
            fit.nadir_base, self._pole, position, self._heading_sigma, self._mean_heading
        )
        return figure_covariance(fit, influence, of_pole)

    def estimate(self, fit: HorizonFit) -> HorizonFit:
        """Return the position brought back, its vertical, and its height above the ellipsoid."""
        distance = self.sphere.mean_radius_m + fit.altitude_m
        position = self._inverse @ (-fit.nadir_base * distance) / self._scale
        along = float(position @ self._pole)
        across = position - along * self._pole
        latitude, _, height = self._planet.geodetic_from_ecef(
            np.array([np.linalg.norm(across), 0.0, along])
        )
        nadir = -position / np.linalg.norm(position)
        if self._vertical == "geodetic" and np.any(across):
            east_free = across / np.linalg.norm(across)
            normal = np.cos(latitude) * east_free + np.sin(latitude) * self._pole
            # Off the centre towards the pole, by the mean over its headings.
            nadir -= np.exp(-0.5 * self._mean_heading**2) * (normal + nadir)
            nadir /= np.linalg.norm(nadir)
        # The covariance turns along; what stretching does to its size is a few parts in a thousand.
        turn = np.eye(4)
        turn[:3, :3] = _shortest_rotation(fit.nadir_base, nadir)
        return replace(
            fit,
            nadir_base=nadir,
            altitude_m=height,
            cov_nadir_altitude=turn @ fit.cov_nadir_altitude @ turn.T,
            disc=Disc(self, fit.nadir_base, fit.rho_rad),
        )


def _up(pose: CoarsePose) -> np.ndarray:
    """Unit vector (3,) of the base frame away from the planet's centre, as the pose has it."""
    up = pose.position_ecef_m @ pose.rot_ecef_from_base
    return np.asarray(up / np.linalg.norm(up))


def _shortest_rotation(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) of a unit vector to another one that is not its opposite."""
    k = skew(np.cross(start, end))
    return np.eye(3) + k + k @ k / (1.0 + float(start @ end))
