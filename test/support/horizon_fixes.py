"""A sensor, what it says of frames, and how far off that is."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from limb_frames import as_frames, clouds, draw, limb_views

from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.mathematics.attitude import angle_rad, tangent_basis
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.earth_scene import Imaging
from horizon_sensor_ros.sim.hard_scenes import HardScene, hard_scenes

NADIR = np.array([0.0, 0.0, 1.0])
SENSOR = HorizonSensor()
SQUARE = (0.0, 1.5)  # azimuths of two cameras whose axes are nearly perpendicular in low orbit


def error_deg(fix: HorizonFix, nadir: np.ndarray) -> float:
    return float(np.degrees(angle_rad(fix.fit.nadir_base, nadir)))


def sigma_deg(fix: HorizonFix) -> float:
    return float(np.degrees(np.sqrt(np.linalg.eigvalsh(fix.fit.cov_nadir_altitude[:3, :3])[-1])))


def nees(fix: HorizonFix, nadir: np.ndarray) -> float:
    """Two degrees of freedom: the error across nadir over its covariance."""
    basis = tangent_basis(nadir)
    error = basis.T @ fix.fit.nadir_base
    return float(
        error @ np.linalg.solve(basis.T @ fix.fit.cov_nadir_altitude[:3, :3] @ basis, error)
    )


def fix_of_one(scene: HardScene, index: int) -> HorizonFix:
    """What one camera of a scene says without the other."""
    one = slice(index, index + 1)
    return SENSOR.process(as_frames(scene.views[one], scene.frames[one]))


def assert_refused(fix: HorizonFix, frames: int) -> None:
    """No estimate anywhere, and a reason."""
    assert not fix.ok
    assert fix.status is not Status.OK
    assert fix.reason
    assert fix.cameras_used == ()
    assert len(fix.limbs) == frames
    assert np.isnan(fix.fit.nadir_base).all()
    assert np.isnan([fix.fit.rho_rad, fix.fit.altitude_m]).all()
    assert np.isnan(fix.fit.cov_nadir_altitude).all()


@lru_cache(maxsize=1)
def clouded_pair() -> tuple[Frame, ...]:
    altitude_m = 500e3
    views = limb_views(altitude_m, azimuths_rad=SQUARE)
    return tuple(as_frames(views, draw(views, altitude_m, clouds(1), Imaging(noise_dn=1.5))))


@lru_cache(maxsize=1)
def clouded_fix() -> HorizonFix:
    return SENSOR.process(clouded_pair())


@lru_cache(maxsize=8)
def scenes_of(kind: str, n: int, seed: int = 21) -> tuple[HardScene, ...]:
    return tuple(hard_scenes(n, seed, (kind,)))
