"""What is refused of fits that look well: edges that are of no limb."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from limb_samples import PINHOLE, observe, view_at_limb

from horizon_sensor_ros.core.fits import LimbObservation, fit_horizon
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.judgement import disagreement_rad, refusal
from horizon_sensor_ros.core.limb_points import SharedError
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

NADIR, PLANET = np.array([0.0, 0.0, 1.0]), Planet()
RHO_RAD = PLANET.rho_from_altitude(800e3)


def seen(scatter_px: float, modelled: bool, cameras: int = 1) -> list[LimbObservation]:
    """Points that claim a tenth of a pixel, and lie off the limb by more."""
    observations = []
    for camera in range(cameras):
        view = view_at_limb(PINHOLE, NADIR, RHO_RAD, 1.6 * camera, name=f"camera_{camera + 1}")
        exact = observe(view, NADIR, RHO_RAD, spacing_px=12.0)
        off = scatter_px * np.random.default_rng(camera).standard_normal(len(exact.limb.px))
        limb = replace(
            exact.limb,
            px=exact.limb.px + off[:, None] * exact.limb.normal_px,
            sigma_px=np.full(len(off), 0.1),
            shared=SharedError(0.1),
            modelled=modelled,
        )
        observations.append(LimbObservation(view, limb))
    return observations


@pytest.mark.parametrize(
    ("scatter_px", "modelled", "cameras", "refused"),
    [
        (0.4, False, 1, True),
        (0.2, False, 1, True),
        (0.3, True, 1, False),
        (0.1, False, 1, False),
        (0.4, False, 2, False),
    ],
)
def test_one_cameras_edges_that_follow_neither_a_model_nor_a_limb(
    scatter_px: float, modelled: bool, cameras: int, refused: bool
) -> None:
    """Beside full clouds two such fits were 1.6 and 4.8 deg off at a sigma of 0.3."""
    observations = seen(scatter_px, modelled, cameras)
    fit = fit_horizon(observations, PLANET)
    assert fit.ok
    alone = [fit_horizon([each], PLANET) for each in observations]
    found = refusal(fit, observations, HorizonConfig(), alone=alone)
    if refused:
        assert found is not None
        status, reason = found
        assert status is Status.POOR_FIT
        assert "camera_1" in reason
    else:
        assert found is None


def test_one_cameras_edge_is_as_even_as_it_is_sharp() -> None:
    """As cloud decks, ice and round parts of the craft are not; mountains may be told."""
    observations = seen(0.5, True)
    fit = fit_horizon(observations, PLANET)
    found = refusal(fit, observations, HorizonConfig())
    assert found is not None
    assert found[0] is Status.POOR_FIT
    assert "times as uneven as it is sharp" in found[1]
    assert refusal(fit, observations, HorizonConfig(limb_unevenness_m=1e3)) is None
    # What neighbours share is no less even than it claims.
    shared = [
        LimbObservation(each.view, replace(each.limb, shared=SharedError(0.4)))
        for each in observations
    ]
    assert refusal(fit, shared, HorizonConfig()) is None
    pair = seen(0.5, True, 2)
    alone = [fit_horizon([each], PLANET) for each in pair]
    assert refusal(fit_horizon(pair, PLANET), pair, HorizonConfig(), alone=alone) is None


def test_two_pieces_of_uneven_edges_do_not_check_each_other() -> None:
    """Two limbs that were refused alone were published together, 1.1 deg off at 0.1 claimed."""
    pieces = []
    for each in seen(0.4, False, 2):
        limb = each.limb
        half = np.arange(len(limb.px)) < 0.25 * len(limb.px)
        pieces.append(LimbObservation(each.view, limb.take(half)))
    fit = fit_horizon(pieces, PLANET)
    assert fit.ok
    unsure = [fit_horizon([each], PLANET) for each in pieces]
    unsure = [replace(one, cov_nadir_altitude=100.0 * one.cov_nadir_altitude) for one in unsure]
    found = refusal(fit, pieces, HorizonConfig(), alone=[one for one in unsure if one.ok])
    assert found is not None
    assert "follows no model" in found[1]
    # One that is even, and knows nadir by itself, does.
    even = seen(0.1, True, 2)[1]
    mixed = [pieces[0], even]
    alone = [fit_horizon([even], PLANET)]
    assert refusal(fit_horizon(mixed, PLANET), mixed, HorizonConfig(), alone=alone) is None


def test_what_lies_under_a_layer_of_airglow_all_along_is_a_limb() -> None:
    observations = seen(0.4, False)
    fit = fit_horizon(observations, PLANET)
    assert refusal(fit, observations, HorizonConfig()) is not None
    assert refusal(fit, observations, HorizonConfig(), layered=True) is None


@pytest.mark.parametrize(
    ("height_m", "spread_m", "refused"),
    [
        (5e3, 5e3, True),
        (45e3, 5e3, True),
        (95e3, 5e3, False),
        (95e3, 30e3, True),
        (130e3, 5e3, True),
    ],
)
def test_a_limb_is_the_grounds_only_at_the_airglows_height(
    height_m: float, spread_m: float, refused: bool
) -> None:
    """All along it: above a limb about another nadir it is high here and low there."""
    observations = seen(0.1, True)
    fit = fit_horizon(observations, PLANET)
    quartiles = height_m - spread_m / 2.0, height_m, height_m + spread_m / 2.0
    found = refusal(fit, observations, HorizonConfig(), layered=True, layer_m=quartiles)
    assert (found is not None) is refused
    if found is not None:
        assert found[0] is Status.POOR_FIT
        assert "airglow" in found[1]


@pytest.mark.parametrize(("sigma_deg", "contradicts"), [(1.0, True), (3.0, False)])
def test_a_camera_contradicts_by_what_it_knows_in_that_direction(
    sigma_deg: float, contradicts: bool
) -> None:
    """However little it knows across it: here 20 deg."""
    apart_rad = np.radians(8.0)
    sigma = np.radians([sigma_deg, 20.0, 0.0, 0.0])
    fits = [
        HorizonFit(
            Status.OK,
            "",
            "ml",
            nadir_base=np.array([np.sin(angle), 0.0, np.cos(angle)]),
            cov_nadir_altitude=np.diag(np.square(sigma)),
        )
        for angle in (0.0, apart_rad)
    ]
    expected = pytest.approx(apart_rad, rel=0.01) if contradicts else None
    assert disagreement_rad(*fits) == expected


@pytest.mark.parametrize("apart_deg", [120.0, 179.9, 180.0])
def test_opposite_nadirs_contradict_each_other(apart_deg: float) -> None:
    """In the tangent plane of the one the other is where it is itself."""
    cov = np.diag([1e-4, 1e-4, 0.0, 1.0])
    apart_rad = np.radians(apart_deg)
    turned = np.array([np.sin(apart_rad), 0.0, np.cos(apart_rad)])
    one, other = (
        HorizonFit(Status.OK, "", "", nadir, RHO_RAD, 800e3, cov) for nadir in (NADIR, turned)
    )
    assert disagreement_rad(one, other) == pytest.approx(apart_rad, abs=1e-9)
