"""From where on a fix does not go with those before, as doc/horizon.md says: with fixes and a gyro
that are told, not measured.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.aiding import Aiding
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.craft_fixed import CraftFixed
from horizon_sensor_ros.core.horizon.fix import HorizonFix
from horizon_sensor_ros.core.horizon.leaps import Leaps
from horizon_sensor_ros.core.status import Status

SURE_DEG, SURE_M = 1e-6, 1e-3
# What a gyro may be off by, three sigma.
GYRO_DEG_S = 0.3


def fix_at(
    tilt_deg: float,
    *,
    altitude_m: float = 500e3,
    sigma_deg: float = SURE_DEG,
    sigma_m: float = SURE_M,
    cameras: int = 1,
) -> HorizonFix:
    """Fix of a nadir that is tilted about x."""
    turn = Rotation.from_euler("x", tilt_deg, degrees=True).as_matrix()
    cov = np.zeros((4, 4))
    cov[:3, :3] = np.radians(sigma_deg) ** 2 * turn @ np.diag([1.0, 1.0, 0.0]) @ turn.T
    cov[3, 3] = sigma_m**2
    fit = HorizonFit(Status.OK, "", "", turn[:, 2], 1.1, altitude_m, cov)
    return HorizonFix(Status.OK, "", fit, (), tuple(f"camera_{i + 1}" for i in range(cameras)))


def later(time_s: float, rate_deg_s: float = 0.0) -> Aiding:
    """So much later, by a gyro that tells a rate about x."""
    rate = np.array([math.radians(rate_deg_s), 0.0, 0.0])
    turn = Rotation.from_rotvec(-time_s * rate).as_matrix()
    return Aiding(rot_now_from_last=turn, rate_base_rad_s=rate, since_last_s=time_s)


# -------------------------------------------------------------------------------- leaps


def leaps_to(before: HorizonFix, new: HorizonFix, aiding: Aiding) -> str:
    leaps = Leaps()
    assert leaps.against(before, aiding) == ""
    return leaps.against(new, aiding)


@pytest.mark.parametrize(("speed_km_s", "believed"), [(95.0, True), (105.0, False)])
@pytest.mark.parametrize("time_s", [0.1, 3.0])
def test_no_craft_is_faster_than_100_km_a_second(
    speed_km_s: float, believed: bool, time_s: float
) -> None:
    higher = fix_at(0.0, altitude_m=500e3 + 1e3 * speed_km_s * time_s)
    assert (leaps_to(fix_at(0.0), higher, later(time_s)) == "") == believed


@pytest.mark.parametrize(("sigmas", "believed"), [(4.8, True), (5.2, False)])
def test_altitudes_may_be_five_sigma_apart(sigmas: float, believed: bool) -> None:
    """Of both fixes: a pair of 3 and 4 has 5."""
    one = fix_at(0.0, sigma_m=3e3)
    other = fix_at(0.0, altitude_m=500e3 + sigmas * 5e3, sigma_m=4e3)
    assert (leaps_to(one, other, later(1e-3)) == "") == believed


@pytest.mark.parametrize("by_sigmas", [0.0, 1.0])
@pytest.mark.parametrize("time_s", [0.1, 20.0])
@pytest.mark.parametrize(("more_deg", "believed"), [(-0.2, True), (0.2, False)])
def test_nadir_moves_no_farther_than_the_craft_turns(
    by_sigmas: float, time_s: float, more_deg: float, believed: bool
) -> None:
    """And two degrees, three sigma of the gyro and five of both fixes."""
    sigma_deg = SURE_DEG + by_sigmas
    rate_deg_s = 0.5
    most_deg = 2.0 + (rate_deg_s + GYRO_DEG_S) * time_s + 5.0 * math.hypot(sigma_deg, sigma_deg)
    new = fix_at(most_deg + more_deg, sigma_deg=sigma_deg)
    told = leaps_to(fix_at(0.0, sigma_deg=sigma_deg), new, later(time_s, rate_deg_s))
    assert (told == "") == believed


# -------------------------------------------------------------------------------- craft fixed


def first_refused(rate_deg_s: float, step_s: float, moves: float = 0.0, sets: int = 2000) -> float:
    """Time at which a fix is refused that moves by a share of what the gyro tells; infinite where
    none is.
    """
    fixed = CraftFixed()
    for k in range(sets):
        fix = fix_at(-moves * rate_deg_s * k * step_s)
        if fixed.against(fix, later(step_s, rate_deg_s)):
            return k * step_s
    return math.inf


@pytest.mark.parametrize("rate_deg_s", [0.5, 1.0, 5.0])
def test_what_stands_still_is_refused_after_two_degrees_and_three_sigma(rate_deg_s: float) -> None:
    step_s = 0.02
    expected_s = 2.0 / (rate_deg_s - GYRO_DEG_S)
    assert first_refused(rate_deg_s, step_s) == pytest.approx(expected_s, abs=2 * step_s)


def test_a_slow_turn_tells_nothing_for_a_gyro_is_asked_for_a_minute() -> None:
    # Two degrees beyond what a gyro may be off by take 55 and 67 s.
    assert first_refused(GYRO_DEG_S + 2 / 55, 0.5) == pytest.approx(55.0, abs=1.0)
    assert first_refused(GYRO_DEG_S + 2 / 67, 0.5) == math.inf


def test_two_glitches_of_a_gyro_are_no_turn() -> None:
    # Each by itself is enough.
    assert first_refused(10.0, 2.0) == 3 * 2.0


@pytest.mark.parametrize(("moves", "refused"), [(0.09, True), (0.11, False)])
def test_what_moves_by_a_tenth_of_what_it_should_does_not_stand_still(
    moves: float, refused: bool
) -> None:
    assert math.isfinite(first_refused(1.0, 0.1, moves, 500)) == refused


def stood() -> CraftFixed:
    """After a fix was found to stand still."""
    fixed = CraftFixed()
    assert any(fixed.against(fix_at(0.0), later(1.0, 2.0)) for _ in range(5))
    return fixed


@pytest.mark.parametrize(("tilt_deg", "refused"), [(0.9, True), (1.1, False)])
def test_a_part_of_the_craft_is_known_again_within_a_degree(tilt_deg: float, refused: bool) -> None:
    assert bool(stood().against(fix_at(tilt_deg), later(0.1))) == refused


def test_and_for_ten_minutes() -> None:
    fixed = stood()
    told = [bool(fixed.against(fix_at(0.0), later(5.0))) for _ in range(200)]
    assert told.index(False) * 5.0 == pytest.approx(600.0, abs=10.0)


def test_several_cameras_refute_it_after_five_seconds() -> None:
    fixed = stood()
    told = [bool(fixed.against(fix_at(0.0, cameras=2), later(0.25))) for _ in range(60)]
    assert told.index(False) * 0.25 == pytest.approx(5.0, abs=0.3)
