"""A target that tumbles in front of a range camera, as a free body does: steady precession."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import pose_matrix, rotation_from_vector
from horizon_sensor_ros.sim.shapes import TriangleMesh, sich_n5
from horizon_sensor_ros.sim.tof_camera import ToFCamera, ToFScan


@dataclass(frozen=True, eq=False)
class TumblingTarget:
    """Target, its motion and the camera that sees it; all is a function of the time in seconds.

    Torque-free motion of a body with two equal moments of inertia: it spins about its own axis
    `spin_axis` (in the mesh's frame), which goes round the angular momentum `momentum_axis` (in the
    camera's frame) at a steady angle.
    """

    mesh: TriangleMesh = field(default_factory=sich_n5)
    camera: ToFCamera = field(default_factory=ToFCamera)
    momentum_axis: tuple[float, float, float] = (0.36, 0.80, 0.48)
    precession_rad_s: float = np.radians(4.0)
    spin_axis: tuple[float, float, float] = (0.0, 1.0, 0.0)
    spin_rad_s: float = np.radians(-2.5)
    attitude_rad: tuple[float, float, float] = (0.4, 0.5, 0.0)  # rotation vector at time 0
    position_m: tuple[float, float, float] = (-0.15, 0.1, 5.6)
    velocity_m_s: tuple[float, float, float] = (0.012, -0.008, -0.02)
    seed: int = 0

    def pose(self, time_s: float) -> np.ndarray:
        """pose_cam_from_target (4, 4), of the mesh's frame."""
        around, own = (
            rotation_from_vector(np.asarray(axis) / np.linalg.norm(axis) * rate * time_s)
            for axis, rate in (
                (self.momentum_axis, self.precession_rad_s),
                (self.spin_axis, self.spin_rad_s),
            )
        )
        turn = around @ rotation_from_vector(np.asarray(self.attitude_rad)) @ own
        return pose_matrix(turn, np.array(self.position_m) + time_s * np.array(self.velocity_m_s))

    def scan(self, time_s: float) -> ToFScan:
        """Expose once; the noise depends on the time and the seed only."""
        rng = np.random.default_rng([self.seed, round(time_s * 1e6)])
        return self.camera.scan(self.mesh, self.pose(time_s), rng)
