"""Two cameras that see the horizon from 500 km, for what runs the nodes rather than the core."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.mathematics.attitude import quaternion_from_rotation
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.earth_camera import render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.poses import camera_from_fov, rot_from_axis

ALTITUDE_M = 500e3
FOV_RAD = np.radians(60.0)


@dataclass(frozen=True)
class Rig:
    """The cameras, one forward and one to the left, on a level craft (base frame: z up)."""

    views: tuple[CameraView, ...]

    @property
    def parameters(self) -> dict[str, list[float]]:
        """Parameters of the nodes: the rotations."""
        return {
            f"{view.name}.rotation": [
                float(value) for value in quaternion_from_rotation(view.rot_base_from_cam)
            ]
            for view in self.views
        }

    @property
    def ros_arguments(self) -> list[str]:
        """The same for a command line, behind --ros-args."""
        return [
            word for name, q in self.parameters.items() for word in ("-p", f"{name}:={list(q)}")
        ]

    def frames(self, count: int, seed: int = 0) -> list[list[np.ndarray]]:
        """Draw so many moments, which differ by their noise: one image a camera."""
        planet, rng = Planet(), np.random.default_rng(seed)
        position = np.array([0.0, 0.0, planet.radius_m + ALTITUDE_M])
        scene = EarthScene(planet=planet)
        drawn = [
            render_views(self.views, np.eye(3), position, scene, rng, imaging=Imaging())
            for _ in range(count)
        ]
        return [[shot.image for shot in shots] for shots in drawn]


def rig(width: int, height: int) -> Rig:
    """Return the rig with frames of this size."""
    off = Planet().rho_from_altitude(ALTITUDE_M)
    camera = camera_from_fov(width, height, FOV_RAD)
    axes = ((np.sin(off), 0.0, -np.cos(off)), (0.0, np.sin(off), -np.cos(off)))
    return Rig(
        tuple(
            CameraView(f"camera_{i}", camera, rot_from_axis(np.array(axis), 0.0))
            for i, axis in enumerate(axes, 1)
        )
    )
