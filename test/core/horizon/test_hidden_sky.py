"""Parts of the craft before the sky: whose limb is believed all the same, and whose is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from horizon_fixes import NADIR, SENSOR, SQUARE, error_deg, nees, sigma_deg
from limb_frames import as_frames, clouds, draw, limb_views
from limb_samples import PINHOLE, observe, view_at_limb
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.hidden_sky import farthest_limb_px
from horizon_sensor_ros.core.horizon.judgement import doubt
from horizon_sensor_ros.core.limb.evidence import SkyEvidence
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.earth_scene import Imaging, Occluder

_ALTITUDE_M, _PLANET = 600e3, Planet()
_RHO_RAD = _PLANET.rho_from_altitude(_ALTITUDE_M)


def behind_a_boom(first_px: float, turned_rad: float = 0.0) -> list[Frame]:
    """Two cameras; from first_px on a sunlit boom, 240 px wide, hides all rows of camera 1, which
    is turned about the base frame's x by so much more than its view says.
    """
    views = limb_views(_ALTITUDE_M, azimuths_rad=SQUARE, roll_rad=0.1)
    last_px = first_px + 240.0
    boom = Occluder(((first_px, -9.0), (last_px, -9.0), (last_px, 489.0), (first_px, 489.0)), 190.0)
    turned = Rotation.from_rotvec([turned_rad, 0.0, 0.0]).as_matrix()
    mounted = replace(views[0], rot_base_from_cam=turned @ views[0].rot_base_from_cam)
    clear = Imaging(noise_dn=1.5)
    drawn = draw(
        (mounted, views[1]), _ALTITUDE_M, clouds(2), (replace(clear, occluders=(boom,)), clear)
    )
    return as_frames(views, drawn)


@pytest.mark.parametrize("first_px", [150.0, 330.0])
def test_the_limb_beside_a_wide_boom_is_used(first_px: float) -> None:
    boom, clear = behind_a_boom(first_px)
    SENSOR.reset()
    alone = SENSOR.process([clear])
    assert alone.ok, alone.reason
    assert not SENSOR.process([boom]).ok
    SENSOR.reset()
    fix = SENSOR.process([boom, clear])
    assert fix.ok, fix.reason
    assert fix.cameras_used == ("camera_1", "camera_2")
    assert sigma_deg(fix) < 0.75 * sigma_deg(alone)
    assert error_deg(fix, NADIR) < 0.05
    assert nees(fix, NADIR) < 20.0


def test_a_limb_that_is_not_where_the_other_camera_expects_it_stays_out() -> None:
    """Turned by 1.7 deg, twenty times what the other camera knows its limb to."""
    boom, clear = behind_a_boom(330.0, 0.03)
    SENSOR.reset()
    fix = SENSOR.process([boom, clear])
    assert fix.ok, fix.reason
    assert fix.cameras_used == ("camera_2",)
    assert "sky" in fix.limbs[0].reason
    assert error_deg(fix, NADIR) < 4.0 * sigma_deg(fix)


def known_to(sigma_m: float, off_rad: float) -> HorizonFit:
    """Fit of the true nadir, and of a radius off_rad too small, whose altitude alone is open."""
    rho = _RHO_RAD - off_rad
    cov = np.diag([0.0, 0.0, 0.0, sigma_m**2])
    altitude_m = _PLANET.altitude_from_rho(rho)
    return HorizonFit(Status.OK, "", "", NADIR, rho, altitude_m, cov, cameras=("camera_2",))


@pytest.mark.parametrize(("off_px", "sigma_px"), [(0.0, 3.0), (4.0, 0.0), (4.0, 1.5)])
def test_how_far_off_the_limb_may_be(off_px: float, sigma_px: float) -> None:
    """Points on the limb, about a nadir that is known: all lie as far off, as far as rho is."""
    view = view_at_limb(PINHOLE, NADIR, _RHO_RAD, 0.3)
    seen = observe(view, NADIR, _RHO_RAD)
    step_rad = 1.0 / PINHOLE.fx
    step_m = _PLANET.altitude_from_rho(_RHO_RAD - step_rad) - _PLANET.altitude_from_rho(_RHO_RAD)
    others = known_to(sigma_px * step_m, off_px * step_rad)
    expected_px = np.hypot(off_px, 2.0 * sigma_px)
    # Away from its axis a lens has more pixels to an angle.
    assert 0.95 * expected_px < farthest_limb_px(seen, others, _PLANET) < 1.35 * expected_px


def test_no_points_may_be_anywhere() -> None:
    view = view_at_limb(PINHOLE, NADIR, _RHO_RAD, 0.3)
    seen = LimbObservation(view, LimbPoints.none(Status.NO_LIMB, "none"))
    assert farthest_limb_px(seen, known_to(1e3, 0.0), _PLANET) == np.inf


def test_what_hides_the_sky_hides_the_limb_beside_it() -> None:
    config = HorizonConfig()
    evidence = SkyEvidence(
        limb_px=500.0,
        bright_sky=0.4,
        lit_limb=1.0,
        clear_sky=0.5,
        contrast=100.0,
        dark_ground=0.0,
        ground_beyond=0.4,
    )
    assert "bright sky" in doubt(evidence, 200.0, 0.02, 0.0, config)
    assert doubt(evidence, 200.0, 0.02, 0.0, config, sky_hidden=True) == ""
    assert "an edge" in doubt(evidence, 140.0, 0.02, 0.0, config, sky_hidden=True)
    # However much is hidden, some of the limb has to be seen.
    covered = replace(evidence, bright_sky=1.0)
    assert "an edge" in doubt(covered, 100.0, 0.02, 0.0, config, sky_hidden=True)
    dim = replace(evidence, contrast=1.0)
    assert "faint" in doubt(dim, 200.0, 0.02, 0.0, config, sky_hidden=True)
