"""The simulated limb's height from place to place."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.sim.earth_scene import EarthScene
from horizon_sensor_ros.sim.scene_light import SceneLight
from horizon_sensor_ros.sim.smooth_texture import smooth_field

UNEVEN_M = 2000.0


def test_rays_pass_the_limb_where_the_field_raises_it() -> None:
    """By height, closed form: a ray's least distance from the centre, less the raised radius."""
    scene = EarthScene(texture_seed=3, limb_uneven_m=UNEVEN_M)
    radius_m = scene.planet.radius_m
    position = np.array([0.0, 0.0, radius_m + 500e3])
    rng = np.random.default_rng(0)
    azimuth, height_m = rng.uniform(0.0, 2.0 * np.pi, 2000), rng.uniform(-8e3, 8e3, 2000)
    # A ray that passes the centre at so much more than the radius.
    sine = (radius_m + height_m) / position[2]
    cosine = np.sqrt(1.0 - sine**2)
    rays = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), -cosine], axis=1)
    lowest = position + (position[2] * cosine)[:, None] * rays
    np.testing.assert_allclose(np.linalg.norm(lowest, axis=1), radius_m + height_m, rtol=1e-9)
    raised = UNEVEN_M * smooth_field(
        lowest / np.linalg.norm(lowest, axis=1)[:, None], 3, (0.03, 1.0)
    )
    clear = np.abs(height_m - raised) > 1.0
    hits = SceneLight(scene, position).hits(rays)
    np.testing.assert_array_equal(hits[clear], (height_m < raised)[clear])
    assert np.std(raised) > 0.5 * UNEVEN_M
