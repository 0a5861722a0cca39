"""A moon's crescent limb, and the planet in its sky, whose whole disc has more of an edge."""

from __future__ import annotations

import numpy as np
import pytest
from horizon_fixes import NADIR, assert_refused, error_deg
from limb_samples import PINHOLE, cone_rays, view_at_limb
from scipy.special import expit

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.search import working_image
from horizon_sensor_ros.core.limb.search.larger_disc import larger_disc_rad
from horizon_sensor_ros.core.planet import Planet

_MOON = Planet(1560e3, has_air=False)
_ALTITUDE_M = 1500e3
_RHO_RAD = _MOON.rho_from_altitude(_ALTITUDE_M)
_SENSOR = HorizonSensor(HorizonConfig(planet=_MOON, tracking=False))
_BESIDE = cone_rays(NADIR, _RHO_RAD + np.radians(9.0), np.array([0.4]))[0]
_VIEW = view_at_limb(PINHOLE, NADIR, _RHO_RAD, 0.4, roll_rad=0.6, offset_rad=np.radians(4.0))


def _angles_rad(view: CameraView, axis: np.ndarray) -> np.ndarray:
    """Of all pixels from an axis (3,), (H, W)."""
    row, column = np.indices((view.camera.height, view.camera.width))
    rays = view.camera.rays(np.stack([column.ravel(), row.ravel()], axis=1).astype(float))
    cosine = rays @ (view.rot_base_from_cam.T @ axis)
    return np.arccos(np.clip(cosine, -1.0, 1.0)).reshape(row.shape)


def limb_beside_a_disc(lit_rad: float, disc_rad: float) -> Frame:
    """A limb that is lit to so far inside in the middle of the frame, and less by the square of the
    azimuth from there; and 9 deg above it a whole disc.
    """
    edge_rad = _VIEW.camera.pixel_rad / 3.0
    inside = _RHO_RAD - _angles_rad(_VIEW, NADIR)
    from_middle = _angles_rad(_VIEW, cone_rays(NADIR, _RHO_RAD, np.array([0.4]))[0])
    lit = lit_rad * np.maximum(1.0 - np.square(from_middle / 0.3), 1e-6)
    beside = disc_rad - _angles_rad(_VIEW, _BESIDE)
    image = 150.0 * expit(inside / edge_rad) * np.clip(1.5 - inside / lit, 0.0, 1.0)
    image += 160.0 * expit(beside / edge_rad)
    image += np.random.default_rng(5).normal(8.0, 1.0, image.shape)
    return Frame(_VIEW, np.clip(np.rint(image), 0, 255).astype(np.uint8))


def test_a_planet_in_the_sky_of_a_moons_crescent_is_not_taken_for_the_moon() -> None:
    fix = _SENSOR.process([limb_beside_a_disc(np.radians(0.6), np.radians(5.0))])
    assert_refused(fix, 1)
    assert "a moon's limb?" in fix.reason


def test_a_small_disc_beside_a_wide_limb_is_nothing_against_it() -> None:
    fix = _SENSOR.process([limb_beside_a_disc(np.inf, np.radians(1.5))])
    assert fix.ok, fix.reason
    assert error_deg(fix, NADIR) < 0.3


def test_the_larger_disc_has_the_crescents_radius() -> None:
    frame = limb_beside_a_disc(np.radians(0.6), np.radians(5.0))

    def found_rad(disc_rad: float) -> float | None:
        return larger_disc_rad([_VIEW], [frame.working], _BESIDE, disc_rad, np.radians(80.0))

    assert found_rad(np.radians(5.0)) == pytest.approx(_RHO_RAD, abs=np.radians(3.0))
    # No limb in the frame is longer than a disc that is wider than the frame.
    assert found_rad(np.radians(40.0)) is None


def test_a_frame_is_reduced_once_however_often_it_is_searched(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    reduced = []
    measured = working_image.reduce_image

    def counted(gray: np.ndarray) -> tuple[np.ndarray, int]:
        reduced.append(gray)
        return measured(gray)

    monkeypatch.setattr(working_image, "reduce_image", counted)
    sensor = HorizonSensor(_SENSOR.config)
    assert not sensor.process([limb_beside_a_disc(np.radians(0.6), np.radians(5.0))]).ok
    assert len(reduced) == 1
