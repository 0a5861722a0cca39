"""Cameras that see the same limb: fits against errors drawn for it, and against textured ground
drawn here.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from limb_samples import PINHOLE, cone_rays, nadir_nees, view_at_limb
from scipy.ndimage import map_coordinates

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.covariance.same_limb import common_stretches
from horizon_sensor_ros.core.covariance.shared_error import with_shared_error
from horizon_sensor_ros.core.fits import LimbObservation, fit_horizon
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb_points import LimbPoints, SharedError
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

NADIR = np.array([0.0, 0.0, 1.0])
PLANET = Planet(has_air=False)
RHO_RAD = PLANET.rho_from_altitude(800e3)
AZIMUTHS = np.arange(-1.0, 3.0, 0.01)
SMALL = Camera(320, 240, 300.0, 300.0, 159.5, 119.5)
FINE = 2  # drawn pixels to a pixel
HEIGHT_M = 500e3


def limb_of(azimuth_rad: float, off_px: np.ndarray, shared: SharedError) -> LimbObservation:
    """Limb of a camera that looks at it in an azimuth: edges off by what is at each of `AZIMUTHS`
    (M,), of which the frame shows some.
    """
    view = view_at_limb(PINHOLE, NADIR, RHO_RAD, azimuth_rad, name=f"camera_{azimuth_rad:.2f}")
    on, wider = (
        view.camera.pixels(cone_rays(NADIR, rho, AZIMUTHS) @ view.rot_base_from_cam)
        for rho in (RHO_RAD, RHO_RAD + 1e-5)
    )
    seen = view.camera.in_frame(on)
    normal = (wider - on)[seen]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    px = on[seen] + off_px[seen, None] * normal
    limb = LimbPoints(Status.OK, "", px, normal, np.full(len(px), 0.1))
    return LimbObservation(view, replace(limb, shared=shared))


def fitted(seen: list[LimbObservation]) -> HorizonFit:
    fit = with_shared_error(fit_horizon(seen, PLANET), seen, PLANET)
    assert fit.ok
    return fit


def sigma_rad(fit: HorizonFit) -> float:
    return float(np.sqrt(np.trace(fit.cov_nadir_altitude[:3, :3])))


@pytest.mark.parametrize("coherent_px", [0.0, 0.05])
@pytest.mark.parametrize("apart_rad", [0.05, 0.4])
def test_what_they_see_alike_is_no_second_look(apart_rad: float, coherent_px: float) -> None:
    rng = np.random.default_rng(3)
    shared = SharedError(coherent_px)
    one, pairs, nees = [], [], []
    for _ in range(200):
        off_px = 0.1 * rng.standard_normal(len(AZIMUTHS))
        # Six stretches to a limb.
        off_px += coherent_px * rng.standard_normal(20).repeat(20)
        seen = [limb_of(azimuth, off_px, shared) for azimuth in (0.0, apart_rad)]
        one.append(sigma_rad(fitted(seen[:1])))
        pair = fitted(seen)
        pairs.append(sigma_rad(pair))
        nees.append(nadir_nees(pair, NADIR))
    # Stretches that happen to lie off far are believed, which adds to the covariance.
    assert (0.8 if coherent_px else 1.4) < np.mean(nees) < 2.6
    # Taken for independent 0.7.
    if apart_rad < 0.1:
        assert 0.85 < np.median(pairs) / np.median(one) < 1.1


def test_limbs_apart_are_independent() -> None:
    off_px = np.zeros(len(AZIMUTHS))
    seen = [limb_of(azimuth, off_px, SharedError()) for azimuth in (0.0, 1.7)]
    rays = [each.rays for each in seen]
    assert common_stretches(NADIR, rays) == []
    assert common_stretches(NADIR, rays[:1]) == []
    assert len(common_stretches(NADIR, [rays[0], rays[0]])) == 2
    plain = fit_horizon(seen, PLANET)
    np.testing.assert_array_equal(
        with_shared_error(plain, seen, PLANET).cov_nadir_altitude, plain.cov_nadir_altitude
    )


def textured(view: CameraView, seed: int) -> Frame:
    """Frame of ground whose brightness varies at all scales, from `HEIGHT_M`."""
    rng = np.random.default_rng(seed)
    grid = rng.normal(size=(32, 32, 32)).astype(np.float32)
    y, x = (np.mgrid[: 240 * FINE, : 320 * FINE] + 0.5) / FINE - 0.5
    rays = np.stack([(x - SMALL.cx) / SMALL.fx, (y - SMALL.cy) / SMALL.fy, np.ones_like(x)], -1)
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True) @ view.rot_base_from_cam.T
    craft = -NADIR * (PLANET.radius_m + HEIGHT_M)
    to_middle = -rays @ craft
    inside = to_middle**2 - (craft @ craft - PLANET.radius_m**2)
    hit = inside > 0.0
    far = to_middle[hit] - np.sqrt(inside[hit])
    up = (craft + far[:, None] * rays[hit]) / PLANET.radius_m
    ground = np.zeros(len(up))
    for octave in range(6):
        place = (up * 9.0 * 2.2**octave + rng.uniform(0.0, 32.0, 3)).T
        ground += 0.14 * 0.8**octave * map_coordinates(grid, place, order=1, mode="grid-wrap")
    drawn = np.zeros(hit.shape)
    drawn[hit] = np.clip(1.0 + 1.5 * ground, 0.1, 2.0)
    drawn = cv2.GaussianBlur(drawn, (0, 0), 0.55 * FINE)
    levels = 8.0 + 100.0 * drawn.reshape(240, FINE, 320, FINE).mean(axis=(1, 3))
    levels += np.random.default_rng(len(view.name) + seed + 100 * int(view.name[-1])).normal(
        0.0, 1.0, levels.shape
    )
    return Frame(view, np.clip(np.rint(levels), 0, 255).astype(np.uint8))


def test_two_cameras_side_by_side_know_what_one_does() -> None:
    rho_rad = PLANET.rho_from_altitude(HEIGHT_M)
    sensor = HorizonConfig(planet=PLANET)
    nees, ratios = [], []
    for seed in range(16):
        frames = [
            textured(view_at_limb(SMALL, NADIR, rho_rad, azimuth, name=name), seed)
            for name, azimuth in (("camera_1", 0.0), ("camera_2", 0.05))
        ]
        one, both = (HorizonSensor(sensor).process(some) for some in (frames[:1], frames))
        if not (one.ok and len(both.fit.cameras) == 2):
            continue
        nees.append(nadir_nees(both.fit, NADIR))
        ratios.append(sigma_rad(both.fit) / sigma_rad(one.fit))
    assert len(nees) > 10
    assert np.mean(nees) < 2.6
    # Taken for independent 0.7.
    assert 0.85 < np.median(ratios) < 1.2
