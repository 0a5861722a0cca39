"""The Sun's glare behind glowing air: lines laid over drawn profiles, and glow that is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from limb_frames import draw, limb_views

from horizon_sensor_ros.core.limb.air import usual_length_px
from horizon_sensor_ros.core.limb.glow.glare import glare_lines, in_glare, reach_px
from horizon_sensor_ros.core.limb.glow.sight import GlowSight, look_along
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging


def _sight(altitude_m: float, outer_px: float | None = None) -> GlowSight:
    view = limb_views(altitude_m, azimuths_rad=(0.4,))[0]
    scene = EarthScene(texture="clouds", texture_seed=5, air_dn=110.0)
    frame = draw((view,), altitude_m, scene, Imaging(noise_dn=1.5), 1)[0]
    nadir, rho = frame.truth.nadir_base, Planet().rho_from_altitude(altitude_m)
    outer_px = outer_px or 2.0 + 3.5 * usual_length_px(view, rho)
    sight = look_along(frame.image, view, nadir, rho, outer_px, 1)
    assert sight is not None
    return sight


@pytest.mark.parametrize("altitude_m", [32e3, 400e3, 1500e3])
def test_glow_is_no_glare_however_far_it_reaches(altitude_m: float) -> None:
    assert not in_glare(_sight(altitude_m))


def test_lines_laid_over_the_profiles_are_found_and_taken_off() -> None:
    reach = reach_px(_sight(400e3))
    assert reach is not None
    from_px, to_px = reach
    plain = _sight(400e3, to_px)
    along = plain.along[:, None]
    lines = np.concatenate([30.0 * np.exp(-along * along), -0.5 * np.exp(-along * along)], axis=1)
    lit = replace(plain, profiles=plain.profiles + lines[:, :1] + lines[:, 1:] * plain.d_px)
    assert in_glare(lit)
    found = glare_lines(lit, from_px)
    assert found is not None
    clear = lit.without_glare(found, from_px, from_px)
    near = plain.d_px <= from_px
    left = clear.profiles - plain.profiles[:, near]
    left -= np.median(left)
    # The noise of means over a stretch, through a line that is seen beyond and drawn on inwards.
    assert np.abs(left).max() < 12.0 * plain.noise
    assert np.sqrt(np.mean(left * left)) < 3.0 * plain.noise
    assert not in_glare(clear)


def test_a_layer_of_airglow_is_no_line() -> None:
    reach = reach_px(_sight(400e3))
    assert reach is not None
    from_px, to_px = reach
    plain = _sight(400e3, to_px)
    assert glare_lines(plain, from_px) is not None
    layer = 12.0 * np.exp(-0.5 * ((plain.d_px - 0.5 * (from_px + to_px)) / 3.0) ** 2)
    assert glare_lines(replace(plain, profiles=plain.profiles + layer), from_px) is None


def test_glow_that_reaches_too_far_leaves_no_sky_to_see_glare_in() -> None:
    sight = _sight(400e3)
    assert reach_px(replace(sight, rise=sight.rise / 20.0)) is None
