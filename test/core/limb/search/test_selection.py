"""Which candidates are the limb: consensus over exact cones with rubbish around them."""

from __future__ import annotations

import numpy as np
import pytest
from limb_samples import BARREL, CAMERAS, FISHEYE, PINHOLE, cone_rays, observe, view_at_limb

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb.search import selection
from horizon_sensor_ros.core.limb.search.candidates import LimbCandidates
from horizon_sensor_ros.core.limb.search.selection import (
    MIN_INLIERS,
    Consensus,
    RayCandidates,
    limb_consensus,
    rays_of_candidates,
)
from horizon_sensor_ros.core.mathematics.attitude import angle_rad
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

PLANET = Planet()
NADIR = np.array([0.3, -0.5, 0.81]) / np.linalg.norm([0.3, -0.5, 0.81])
WIDE = {"rho_min_rad": np.radians(3.0), "rho_max_rad": np.radians(89.0)}
PITCH_PX = 2.0


def views_around(altitude_m: float, cameras: list[Camera]) -> list[CameraView]:
    rho = PLANET.rho_from_altitude(altitude_m)
    return [
        view_at_limb(camera, NADIR, rho, 0.3 + 1.5 * i, 0.7 * i, 0.0, f"camera_{i + 1}")
        for i, camera in enumerate(cameras)
    ]


def candidates_of(
    view: CameraView,
    rho: float,
    rng: np.random.Generator,
    outliers: float = 0.0,
    turn_rad: float = 0.0,
) -> LimbCandidates:
    """A limb to whole grid steps, and this share of others: half of them edges along arcs of
    clouds, well below the limb, that look the same way; half anywhere, with any direction.
    """
    limb = observe(view, NADIR, rho, spacing_px=PITCH_PX).limb
    count = len(limb.px)
    px = limb.px + rng.uniform(-PITCH_PX / 2, PITCH_PX / 2, (count, 2))
    wobble = rng.normal(0.0, 0.15, count) + turn_rad
    cos, sin = np.cos(wobble), np.sin(wobble)
    nx, ny = limb.normal_px.T
    normal = np.column_stack([cos * nx - sin * ny, sin * nx + cos * ny])
    extra = round(count * outliers / (1.0 - outliers))
    along = rng.integers(0, count, extra // 2)
    depth = 25.0 + 60.0 * (1.0 + np.sin(along / 40.0)) + rng.normal(0.0, 3.0, len(along))
    clouds = px[along] - depth[:, None] * normal[along]
    size = [view.camera.width - 1, view.camera.height - 1]
    anywhere = rng.uniform(0, 1, (extra - len(along), 2)) * size
    angle = rng.uniform(-np.pi, np.pi, len(anywhere))
    px = np.vstack([px, clouds, anywhere])
    normal = np.vstack([normal, normal[along], np.column_stack([np.cos(angle), np.sin(angle)])])
    return LimbCandidates(px, normal, np.full(len(px), 100.0), PITCH_PX)


def consensus_of(
    cameras: list[Camera], altitude_m: float, outliers: float = 0.0, seed: int = 0,
    turn_rad: float = 0.0, **bounds: float,
) -> tuple[Consensus, RayCandidates]:  # fmt: skip
    rho = PLANET.rho_from_altitude(altitude_m)
    views = views_around(altitude_m, cameras)
    rng = np.random.default_rng(seed)
    candidates = [candidates_of(view, rho, rng, outliers, turn_rad) for view in views]
    found = rays_of_candidates(views, candidates)
    return limb_consensus(found, **{**WIDE, **bounds}), found


@pytest.mark.parametrize("cameras", [[PINHOLE], [PINHOLE, BARREL], [PINHOLE, BARREL, FISHEYE]])
@pytest.mark.parametrize("altitude_m", [350e3, 2500e3])
def test_finds_the_disc_among_sixty_percent_rubbish(
    cameras: list[Camera], altitude_m: float
) -> None:
    rho = PLANET.rho_from_altitude(altitude_m)
    for seed in range(3):
        consensus, found = consensus_of(cameras, altitude_m, outliers=0.6, seed=seed)
        assert consensus.status is Status.OK, consensus.reason
        # Whole grid steps along an arc in one camera leave this much; the refinement's reach is
        # what it must be within: no point of the limb off by more than a few grid steps.
        limb = np.abs(np.arccos(found.rays @ NADIR) - rho) < found.pitch_rad
        off = np.arccos(found.rays[limb] @ consensus.nadir_base) - consensus.rho_rad
        assert np.abs(off / found.pitch_rad[limb]).max() < 2.5
        wrong = np.abs(np.arccos(found.rays @ NADIR) - rho) > 6 * found.pitch_rad
        assert np.mean(consensus.inliers[wrong]) < 0.06
        assert np.mean(consensus.inliers[limb]) > 0.8
        if len(cameras) > 1:
            assert angle_rad(consensus.nadir_base, NADIR) < np.radians(0.3)
            assert consensus.rho_rad == pytest.approx(rho, abs=np.radians(0.3))


def test_candidates_that_agree_need_no_draw(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = consensus_of(CAMERAS[:2], 420e3, outliers=0.3)[0]
    assert not drawn.unanimous
    monkeypatch.setattr(selection, "_hypotheses", None)
    consensus, found = consensus_of(CAMERAS[:2], 420e3, outliers=0.0)
    assert consensus.unanimous
    assert angle_rad(consensus.nadir_base, NADIR) < np.radians(0.2)
    assert consensus.inliers.sum() > 0.9 * len(found.rays)


def test_shares_unknowns_between_cameras() -> None:
    """Two short pieces that say little alone say much together."""
    altitude = 500e3
    rho = PLANET.rho_from_altitude(altitude)
    views = views_around(altitude, [PINHOLE, PINHOLE])
    rng = np.random.default_rng(5)
    every = [candidates_of(view, rho, rng) for view in views]
    short = [
        LimbCandidates(c.px[100:160], c.normal_px[100:160], c.contrast[100:160], PITCH_PX)
        for c in every
    ]
    together = limb_consensus(rays_of_candidates(views, short), **WIDE)
    assert together.status is Status.OK
    assert angle_rad(together.nadir_base, NADIR) < np.radians(1.0)
    for view, part in zip(views, short, strict=True):
        alone = limb_consensus(rays_of_candidates([view], [part]), **WIDE)
        if alone.status is Status.OK:
            assert angle_rad(alone.nadir_base, NADIR) > angle_rad(together.nadir_base, NADIR)


def test_is_deterministic() -> None:
    first, _ = consensus_of([PINHOLE, BARREL], 400e3, outliers=0.6)
    np.random.default_rng().random(10)
    second, _ = consensus_of([PINHOLE, BARREL], 400e3, outliers=0.6)
    np.testing.assert_array_equal(first.nadir_base, second.nadir_base)
    assert first.rho_rad == second.rho_rad
    np.testing.assert_array_equal(first.inliers, second.inliers)


def test_does_not_depend_on_the_base_frame() -> None:
    """A turned base frame turns the answer with it."""
    rho = PLANET.rho_from_altitude(600e3)
    views = views_around(600e3, [PINHOLE, BARREL])
    turn = cone_rays(np.array([1.0, 0.0, 0.0]), 0.5, np.array([0.0, 1.0, 2.0]))
    turn, _ = np.linalg.qr(turn.T)
    turn *= np.sign(np.linalg.det(turn))
    turned = [CameraView(v.name, v.camera, turn @ v.rot_base_from_cam) for v in views]
    rng = np.random.default_rng(2)
    candidates = [candidates_of(view, rho, rng, 0.4) for view in views]
    here = limb_consensus(rays_of_candidates(views, candidates), **WIDE)
    there = limb_consensus(rays_of_candidates(turned, candidates), **WIDE)
    np.testing.assert_allclose(there.nadir_base, turn @ here.nadir_base, atol=1e-9)
    np.testing.assert_array_equal(here.inliers, there.inliers)


@pytest.mark.parametrize(("low_m", "high_m"), [(10e3, 400e3), (1200e3, 50000e3)])
def test_altitude_bounds_exclude_the_disc(low_m: float, high_m: float) -> None:
    """The limb of 700 km is no answer, nor is any other consensus outside the bounds."""
    bounds = {
        "rho_min_rad": PLANET.rho_from_altitude(high_m),
        "rho_max_rad": PLANET.rho_from_altitude(low_m),
    }
    consensus, _ = consensus_of([PINHOLE, PINHOLE], 700e3, **bounds)
    if consensus.status is Status.OK:  # a few candidates may agree on a disc within the bounds
        assert bounds["rho_min_rad"] <= consensus.rho_rad <= bounds["rho_max_rad"]
        assert consensus.inliers.mean() < 0.5
    else:
        assert consensus.reason
        assert np.isnan(consensus.nadir_base).all()
    within, found = consensus_of([PINHOLE, PINHOLE], 700e3)
    assert within.inliers.mean() > 0.9
    assert len(found.rays) == len(within.inliers)


def test_planet_inside_out_is_no_disc() -> None:
    """Every edge with its bright side outwards: a window, not a planet."""
    consensus, _ = consensus_of([PINHOLE, BARREL], 500e3, turn_rad=np.pi)
    assert consensus.status is Status.NO_LIMB
    assert consensus.reason
    assert np.isnan(consensus.nadir_base).all()
    assert np.isnan(consensus.rho_rad)
    assert consensus_of([PINHOLE, BARREL], 500e3)[0].status is Status.OK


def test_edges_that_run_across_are_no_disc() -> None:
    consensus, _ = consensus_of([PINHOLE, BARREL], 500e3, turn_rad=np.pi / 2)
    assert consensus.status is Status.NO_LIMB


def test_nothing_and_next_to_nothing() -> None:
    views = views_around(500e3, [PINHOLE, BARREL])
    nothing = rays_of_candidates(views, [LimbCandidates(), LimbCandidates()])
    assert len(nothing.rays) == 0
    assert limb_consensus(nothing, **WIDE).status is Status.NO_LIMB
    one = candidates_of(views[0], PLANET.rho_from_altitude(500e3), np.random.default_rng(0))
    few = MIN_INLIERS - 1
    some = LimbCandidates(one.px[:few], one.normal_px[:few], one.contrast[:few], PITCH_PX)
    refused = limb_consensus(rays_of_candidates(views, [some, LimbCandidates()]), **WIDE)
    assert refused.status is Status.NO_LIMB
    assert str(few) in refused.reason


def test_the_same_point_over_and_over_is_no_disc() -> None:
    px = np.tile([[300.0, 200.0]], (50, 1))
    normal = np.tile([[0.0, -1.0]], (50, 1))
    same = LimbCandidates(px, normal, np.ones(50), PITCH_PX)
    views = views_around(500e3, [PINHOLE])
    assert limb_consensus(rays_of_candidates(views, [same]), **WIDE).status is Status.NO_LIMB


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda c: c.model + str(len(c.distortion)))
def test_rays_of_candidates(camera: Camera) -> None:
    """Rays lie on the cone, outward leads away from nadir, and one pitch is its angle."""
    rho = PLANET.rho_from_altitude(800e3)
    view = view_at_limb(camera, NADIR, rho, 0.4, 0.8)
    limb = observe(view, NADIR, rho, spacing_px=3.0).limb
    inner = np.linalg.norm(limb.px - [camera.cx, camera.cy], axis=1) < 300.0
    px, normal = limb.px[inner], limb.normal_px[inner]
    found = rays_of_candidates(
        [view], [LimbCandidates(px, normal, np.full(len(px), 50.0), PITCH_PX)]
    )
    np.testing.assert_allclose(found.rays @ NADIR, np.cos(rho), atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(found.rays, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.sum(found.rays * found.outward, axis=1), 0.0, atol=1e-12)
    # away from nadir, u . n falls at the rate sin rho, as far as the lens keeps angles
    fall = -(found.outward @ NADIR) / np.sin(rho)
    assert fall.min() > 0.8
    assert np.median(fall) > 0.98
    wide = view.camera.pixels(
        (np.cos(found.pitch_rad)[:, None] * found.rays
         + np.sin(found.pitch_rad)[:, None] * found.outward) @ view.rot_base_from_cam
    )  # fmt: skip
    moved = np.linalg.norm(wide - px, axis=1)
    np.testing.assert_allclose(moved, PITCH_PX, rtol=0.03)


def test_pixels_without_a_ray_are_dropped() -> None:
    """The corners of a strong fisheye see nothing."""
    camera = Camera(640, 640, 90.0, 90.0, 320.0, 320.0, "equidistant")
    view = CameraView("fisheye", camera, np.eye(3))
    px = np.stack([np.full(10, 320.0), np.linspace(100.0, 300.0, 10)], axis=1)
    px[[0, 5]] = [2.0, 2.0], [637.0, 637.0]
    seen = np.isfinite(camera.rays(px)).all(axis=1)
    assert np.flatnonzero(~seen).tolist() == [0, 5]
    normal = np.tile([[0.0, -1.0]], (10, 1))
    found = rays_of_candidates([view], [LimbCandidates(px, normal, np.arange(1.0, 11.0), 1.0)])
    np.testing.assert_allclose(found.rays, camera.rays(px[seen]), atol=1e-12)
    assert len(found.weight) == len(found.camera) == len(found.pitch_rad) == 8


def test_a_camera_whose_edges_lie_where_its_lens_sees_nothing_is_not_heard() -> None:
    """As with the coefficients of another model of distortion: wrong by 20 deg and more."""
    camera = Camera(640, 640, 90.0, 90.0, 320.0, 320.0, "equidistant")
    view = CameraView("fisheye", camera, np.eye(3))
    px = np.stack([np.full(10, 320.0), np.linspace(100.0, 300.0, 10)], axis=1)
    px[:3] = [2.0, 2.0], [637.0, 637.0], [2.0, 637.0]
    normal = np.tile([[0.0, -1.0]], (10, 1))
    assert len(rays_of_candidates([view], [LimbCandidates(px, normal, np.ones(10), 1.0)]).rays) == 0


def test_cameras_are_numbered() -> None:
    views = views_around(500e3, [PINHOLE, BARREL, FISHEYE])
    rng = np.random.default_rng(1)
    rho = PLANET.rho_from_altitude(500e3)
    candidates = [candidates_of(views[0], rho, rng), LimbCandidates(),
                  candidates_of(views[2], rho, rng)]  # fmt: skip
    found = rays_of_candidates(views, candidates)
    assert np.unique(found.camera).tolist() == [0, 2]
    assert np.count_nonzero(found.camera == 0) == len(candidates[0])
    assert np.all((found.weight > 0) & (found.weight <= 1))
