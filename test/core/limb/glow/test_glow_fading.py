"""Lenses that darken towards the corners: against numerical integrals and drawn frames."""

from __future__ import annotations

import numpy as np
import pytest
from limb_frames import draw, limb_views
from limb_samples import nadir_nees

from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.air import FADING_SIGMA
from horizon_sensor_ros.core.limb.glow.fading import either_lens, with_either_lens
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging

_MISJUDGED, _SHARE, _EVEN_SIGMA = 1.8, 0.1, 0.02


def _normal(x: np.ndarray, mean: float, sigma: float) -> np.ndarray:
    return np.asarray(np.exp(-0.5 * np.square((x - mean) / sigma)) / sigma)


@pytest.mark.parametrize("seen", [-0.3, 0.0, 0.05, 0.6, 0.75, 0.9, 1.3])
def test_mean_over_lenses_is_the_integral_over_their_fading(seen: float) -> None:
    """One lens in ten loses light, none gains any; the others are even."""
    sigma = 0.1
    fading = np.linspace(-2.0, 4.0, 600_001)
    lost = 2.0 * _normal(fading, 0.0, FADING_SIGMA) * (fading > 0.0)
    weight = _SHARE * lost + (1.0 - _SHARE) * _normal(fading, 0.0, _EVEN_SIGMA)
    weight *= _normal(fading, seen, _MISJUDGED * sigma)
    weight /= weight.sum()
    mean = float(weight @ fading)
    variance = float(weight @ np.square(fading - mean))
    with_one = 1.0 / (sigma**-2.0 + FADING_SIGMA**-2.0)
    found, spread = either_lens(with_one * seen / sigma**2, with_one)
    assert found == pytest.approx(mean, rel=0.05, abs=0.01)
    assert 0.9 * variance < spread < 1.05 * variance + 3e-3


def test_what_hangs_together_with_fading_follows_it() -> None:
    """As in a fit with fading known so well."""
    rng = np.random.default_rng(2)
    rows = rng.normal(size=(9, 4))
    information = rows.T @ rows
    change = rng.normal(size=4)
    cov = np.linalg.inv(information)
    mean, variance = either_lens(0.4 + change[2], cov[2, 2])
    step, spread = with_either_lens(change, cov, 2, 0.4)
    more = 1.0 / variance - 1.0 / cov[2, 2]
    known = information.copy()
    known[2, 2] += more
    pull = information @ change
    pull[2] += more * (mean - 0.4) + (mean - 0.4 - change[2]) / cov[2, 2]
    assert np.allclose(spread, np.linalg.inv(known))
    assert np.allclose(step, np.linalg.solve(known, pull))


def test_one_camera_with_a_fading_lens_is_no_wronger_than_it_claims() -> None:
    """The glow's contour bends with the lens: it was taken for the limb's own."""
    altitude_m, nees = 450e3, []
    for seed in range(16):
        (view,) = limb_views(altitude_m, azimuths_rad=(0.6 * seed,))
        scene = EarthScene(texture="clouds", texture_seed=seed, air_dn=110.0)
        imaging = Imaging(noise_dn=1.5, vignetting=0.4 + 0.03 * seed)
        drawn = draw((view,), altitude_m, scene, imaging, seed)[0]
        found = HorizonSensor().process([Frame(view, drawn.image)])
        if not found.ok:
            continue
        nees.append(nadir_nees(found.fit, drawn.truth.nadir_base))
    assert len(nees) >= 12
    assert np.mean(nees) < 2.5
    assert max(nees) < 11.8
