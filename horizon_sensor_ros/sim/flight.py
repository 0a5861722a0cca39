"""A simulated flight: circular orbit, smooth attitude motion, two cameras, frames at any time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.mathematics.rigid import vector_from_rotation
from horizon_sensor_ros.sim.earth_camera import SimFrame, render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.poses import ROT_BASE_FROM_BODY, rot_level_from_body, side_views

_GRAVITY_EARTH = 3.986004418e14  # m^3 / s^2
_EARTH_RATE = 7.292115e-5  # rad / s
_SWING_S = 8.0
_PEAK = 0.75 + 0.25 * 2.7  # of a swing's rate, over its amplitude times its angular frequency


@dataclass(frozen=True)
class Swing:
    """One angle of the attitude over time: a mean and two slow sines about it."""

    mean_rad: float = 0.0
    amplitude_rad: float = 0.0
    period_s: float = 20.0
    phase_rad: float = 0.0
    rate_rad_s: float = 0.0

    def at(self, time_s: float) -> float:
        """Angle in radians at a time."""
        turn = 2.0 * np.pi * time_s / self.period_s + self.phase_rad
        wave = 0.75 * np.sin(turn) + 0.25 * np.sin(2.7 * turn)
        return float(self.mean_rad + self.amplitude_rad * wave + self.rate_rad_s * time_s)


@dataclass(frozen=True)
class Flight:
    """Orbit, attitude and cameras; everything is a function of the time in seconds.

    The body (forward, right, down) swings about the level frame whose x points along the track.
    base_axes : "frd" or "flu", see `poses.side_views`; the two cameras are perpendicular.
    readout_s : of their rolling shutters, from the first row to the last; 0: none. exposure_s : of
    their frames, about a frame's time.
    """

    altitude_m: float = 400e3
    inclination_rad: float = np.radians(51.6)
    node_rad: float = 0.3  # longitude of the ascending node at time 0
    start_rad: float = 0.6  # angle from the node at time 0
    roll: Swing = Swing(0.12, np.radians(3.0), 17.0, 0.4)
    pitch: Swing = Swing(-0.12, np.radians(2.5), 23.0, 1.9)
    yaw: Swing = Swing(rate_rad_s=np.radians(0.5))
    camera: Camera = field(default_factory=lambda: Camera(640, 480, 457.0, 457.0, 319.5, 239.5))
    base_axes: str = "frd"
    scene: EarthScene = field(
        default_factory=lambda: EarthScene(texture="clouds", texture_seed=7, air_dn=60.0)
    )
    imaging: Imaging = field(default_factory=Imaging)
    seed: int = 0
    readout_s: float = 0.0
    exposure_s: float = 0.0

    @property
    def views(self) -> tuple[CameraView, CameraView]:
        """The two cameras in the base frame."""
        return side_views(self.camera, self.base_axes)

    def pose(self, time_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Attitude rot_world_from_base (3, 3) and position_ecef_m (3,)."""
        earth_from_inertial = _about_z(-_EARTH_RATE * time_s)
        position, velocity = self._orbit(time_s)
        down = -position / np.linalg.norm(position)
        along = velocity / np.linalg.norm(velocity)
        level = np.stack([along, np.cross(down, along), down], axis=1)
        body = rot_level_from_body(*(s.at(time_s) for s in (self.roll, self.pitch, self.yaw)))
        base = ROT_BASE_FROM_BODY[self.base_axes]
        return earth_from_inertial @ level @ body @ base.T, earth_from_inertial @ position

    def frames(self, time_s: float) -> tuple[SimFrame, ...]:
        """Draw the frames of both cameras; the noise depends on the time and the seed only."""
        rng = np.random.default_rng([self.seed, round(time_s * 1e6)])
        rot, position = self.pose(time_s)
        return render_views(
            self.views,
            rot,
            position,
            self.scene,
            rng,
            imaging=self.imaging,
            turn_base_rad=self.turn(time_s - 0.5 * self.exposure_s, self.exposure_s),
            readout_turn_base_rad=self.turn(time_s, self.readout_s),
        )

    def turn(self, time_s: float, span_s: float) -> np.ndarray:
        """Rotation vector (3,) by which the base frame turns within a span, in its own axes."""
        if span_s == 0.0:
            return np.zeros(3)
        (before, _), (after, _) = self.pose(time_s), self.pose(time_s + span_s)
        return vector_from_rotation(before.T @ after)

    def _orbit(self, time_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Position (m) and velocity (m/s) in the inertial frame that is the world's at time 0."""
        radius = self.scene.planet.mean_radius_m + self.altitude_m
        rate = np.sqrt(_GRAVITY_EARTH / radius**3)
        angle = self.start_rad + rate * time_s
        ci, si = np.cos(self.inclination_rad), np.sin(self.inclination_rad)
        plane = _about_z(self.node_rad) @ np.array([[1.0, 0.0], [0.0, ci], [0.0, si]])
        position = plane @ np.array([np.cos(angle), np.sin(angle)])
        velocity = plane @ np.array([-np.sin(angle), np.cos(angle)])
        return radius * position, radius * rate * velocity


def swinging_flight(rate_rad_s: float, rng: np.random.Generator) -> Flight:
    """Low over clouds, a craft whose roll and pitch swing at rates up to this one."""
    amplitude = rate_rad_s * _SWING_S / (2.0 * np.pi * _PEAK)
    roll, pitch, start, node = rng.uniform(0.0, 2.0 * np.pi, 4)
    return Flight(
        altitude_m=float(rng.uniform(300e3, 800e3)),
        node_rad=float(node),
        start_rad=float(start),
        roll=Swing(0.12, amplitude, _SWING_S, float(roll)),
        pitch=Swing(-0.12, amplitude, 0.9 * _SWING_S, float(pitch)),
        scene=EarthScene(texture="clouds", texture_seed=int(rng.integers(2**31))),
        imaging=Imaging(noise_dn=4.0),
        seed=int(rng.integers(2**31)),
    )


def _about_z(angle_rad: float) -> np.ndarray:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
