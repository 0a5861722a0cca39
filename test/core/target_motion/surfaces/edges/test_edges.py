"""Edges of thin parts that run obliquely, and of faces, drawn in closed form."""

from dataclasses import fields

import numpy as np
import pytest

from horizon_sensor_ros.core.target_motion.ranges.range_image import range_image
from horizon_sensor_ros.core.target_motion.surfaces.edges.detection import find_edges
from horizon_sensor_ros.core.target_motion.surfaces.edges.edges import Edges
from horizon_sensor_ros.core.target_motion.surfaces.planes import local_planes

FOCAL_PX, SIDE_PX, DEPTH_M = 320.0, 160, 4.0


def edges_of_bar(angle_deg: float, width_px: float, seed: int) -> tuple[Edges, np.ndarray]:
    """Edges of a flat bar across a disc behind it, as wide in the image as that; and its unit
    normal (2,) there. Away from its ends.
    """
    rng = np.random.default_rng(seed)
    middle = (SIDE_PX - 1) / 2 + rng.uniform(-0.5, 0.5, 2)
    u, v = np.meshgrid(*2 * [np.arange(float(SIDE_PX))])
    off = np.stack([u - middle[0], v - middle[1]], axis=-1)
    turn = np.radians(angle_deg)
    along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    on_bar = (np.abs(off @ across) < width_px / 2) & (np.abs(off @ along) < 65)
    on_disc = np.hypot(*np.moveaxis(off, -1, 0)) < 20
    depth = np.where(on_bar, DEPTH_M, np.where(on_disc, DEPTH_M + 1.0, np.nan))
    depth += rng.normal(0, 0.004, depth.shape)
    rays = np.stack([u / FOCAL_PX - 0.25, v / FOCAL_PX - 0.25, np.ones_like(u)], axis=-1)
    image = range_image(rays * depth[..., None], FOCAL_PX)
    edges = find_edges(image, local_planes(image))
    spot = (edges.points[:, :2] / edges.points[:, 2:] + 0.25) * FOCAL_PX - middle
    free = (np.abs(spot @ along) < 58) & (np.abs(spot @ along) > 28)
    free &= np.abs(spot @ across) < 12
    kept = Edges(*(getattr(edges, each.name)[free] for each in fields(Edges)))
    return kept, (spot @ across)[free] * np.sign(edges.sides[free, :2] @ across)


@pytest.mark.parametrize("width_px", [2.0, 3.0, 4.0])
@pytest.mark.parametrize("angle_deg", [35.0, 42.0, 60.0, 125.0, 140.0])
def test_both_sides_of_an_oblique_bar_are_edges(angle_deg: float, width_px: float) -> None:
    """There were none at all."""
    turn = np.radians(angle_deg)
    across = np.array([-np.sin(turn), np.cos(turn)])
    for seed in range(3):
        edges, outwards_px = edges_of_bar(angle_deg, width_px, seed)
        sides = edges.sides[:, :2] @ across
        # Of 60 pixels of either side, with one place a row and a column.
        assert np.count_nonzero(sides > 0.9) > 25
        assert np.count_nonzero(sides < -0.9) > 25
        assert np.mean(np.abs(sides) > 0.95) > 0.9
        assert abs(np.median(outwards_px) - width_px / 2) < 0.3
        assert np.quantile(np.abs(outwards_px - width_px / 2), 0.9) < 0.6


@pytest.mark.parametrize("angle_deg", [0.0, 90.0])
def test_a_bar_along_the_pixels_is_known_better(angle_deg: float) -> None:
    straight, outwards_px = edges_of_bar(angle_deg, 3.0, 0)
    oblique, _ = edges_of_bar(42.0, 3.0, 0)
    assert len(straight) > 100
    assert np.median(oblique.sigma_m) > 2 * np.median(straight.sigma_m)
    assert abs(np.median(outwards_px) - 1.5) < 0.5


@pytest.mark.parametrize("reach_m", [0.0, 0.06])
def test_a_line_is_as_rough_as_its_returns_scatter(reach_m: float) -> None:
    # The pixels of a rim show it, or what lies behind it by up to ``reach_m``.
    rng = np.random.default_rng(1)
    depth = np.full((SIDE_PX, SIDE_PX), np.nan)
    depth[40:120, 60] = DEPTH_M + rng.uniform(0, reach_m, 80) * rng.integers(0, 2, 80)
    depth[90:130, 80:130] = DEPTH_M + 1.5
    depth += rng.normal(0, 0.004, depth.shape)
    v, u = np.mgrid[:SIDE_PX, :SIDE_PX]
    rays = np.stack([u / FOCAL_PX - 0.25, v / FOCAL_PX - 0.25, np.ones(u.shape)], axis=-1)
    image = range_image(rays * depth[..., None], FOCAL_PX)
    edges = find_edges(image, local_planes(image))
    thin = np.isfinite(edges.fronts[:, 0])
    assert np.count_nonzero(thin) > 20
    rough = np.median(edges.rough_m[thin])
    assert rough == 0 if reach_m == 0 else 0.008 < rough < 0.03
    assert (edges.rough_m[~thin] == 0).all()


@pytest.mark.parametrize("fall_m", [0.0, 0.04])
def test_the_end_of_a_steep_strip_is_known_to_a_pixel(fall_m: float) -> None:
    """A plate seen nearly edge on, two rows high, that falls back by ``fall_m`` a row: its ends lie
    anywhere in their rows, and all along them alike, so that they scatter little.
    """
    rng = np.random.default_rng(2)
    depth = np.full((SIDE_PX, SIDE_PX), np.nan)
    depth[80:82, 40:120] = DEPTH_M + fall_m * np.arange(2)[:, None]
    depth[130:150, 60:100] = DEPTH_M
    u, v = np.meshgrid(*2 * [np.arange(float(SIDE_PX))])
    depth += rng.normal(0, 0.004, depth.shape)
    rays = np.stack([u / FOCAL_PX - 0.25, v / FOCAL_PX - 0.25, np.ones_like(u)], axis=-1)
    image = range_image(rays * depth[..., None], FOCAL_PX)
    edges = find_edges(image, local_planes(image))
    strip = np.isfinite(edges.fronts[:, 0]) & (np.abs(edges.sides[:, 1]) > 0.9)
    column, row = (edges.points[strip, :2] / edges.points[strip, 2:] + 0.25).T * FOCAL_PX
    some = (np.abs(row - 80.5) < 5) & (np.abs(column - 80) < 35)
    assert np.count_nonzero(some) > 60
    rough = edges.rough_m[strip][some]
    assert abs(np.median(rough) - fall_m / np.sqrt(12)) < 0.004


def test_a_gap_in_a_scan_is_no_end_of_a_face() -> None:
    """Returns strewn over a face at random, but for a band that the scan left out, on no grid."""
    rng = np.random.default_rng(3)
    place = rng.uniform(-0.5, 0.5, (12000, 2))
    place = place[np.abs(place @ (0.8, 0.6) - 0.05) > 0.04]
    points = np.column_stack([place, DEPTH_M + 0.3 * place[:, 0]])
    points *= 1 + rng.normal(0, 0.002, len(points))[:, None] / DEPTH_M
    image = range_image(points)
    assert not image.on_grid
    edges = find_edges(image, local_planes(image))
    assert len(edges) > 100
    outermost = np.abs(edges.points[:, :2]).max(axis=1)
    # But for where the gap meets the outline; without it two thirds lay along the gap.
    assert np.mean(outermost > 0.46) > 0.9


def test_an_edge_along_the_pixels_is_off_as_one() -> None:
    """By up to half a pixel, as its row is; the more rows it crosses the less is claimed."""
    off_px, claims_px = [], {}
    for angle_deg in (0.0, 1.0, 4.0):
        claimed_px = []
        for seed in range(100):
            edges, outwards_px = edges_of_bar(angle_deg, 3.0, seed)
            claimed_px.append(np.median(edges.alike_m) * FOCAL_PX / DEPTH_M)
            if angle_deg == 0.0:
                off_px.append(np.mean(outwards_px[edges.sides[:, 1] < 0] - 1.5))
        claims_px[angle_deg] = np.median(claimed_px)
    assert claims_px[0.0] == pytest.approx(np.sqrt(np.mean(np.square(off_px))), rel=0.15)
    assert claims_px[1.0] < claims_px[0.0] / 2.5
    assert claims_px[4.0] < claims_px[0.0] / 10


@pytest.mark.parametrize("angle_deg", [0.0, 0.6])
def test_a_few_places_beside_the_rest_tell_nothing_of_an_edge(angle_deg: float) -> None:
    """Noise puts a place of an edge into the next row now and then. Where that made it a row
    higher, the mean square of these was 1.6 and 1.7.
    """
    squares = []
    for seed in range(60):
        edges, outwards_px = edges_of_bar(angle_deg, 3.0, seed)
        above = edges.sides[:, 1] < 0
        for run in np.unique(edges.run[above]):
            of = above & (edges.run == run)
            if np.count_nonzero(of) > 10:
                own2 = np.mean(edges.sigma_m[of] ** 2) / np.count_nonzero(of)
                claim_px = np.sqrt(np.median(edges.alike_m[of]) ** 2 + own2) * FOCAL_PX / DEPTH_M
                squares.append(np.square(np.mean(outwards_px[of] - 1.5) / claim_px))
    assert len(squares) == 60
    assert np.mean(squares) < 1.25


@pytest.mark.parametrize(("noise_m", "slope"), [(0.004, 0.0), (0.02, 0.0), (0.02, -0.6)])
def test_how_far_away_the_end_of_a_face_is_comes_with_its_noise(
    noise_m: float, slope: float
) -> None:
    """Of all places on a side of a face the mean is off by what each claims, as if they had noise
    of their own. slope : by which the face falls back towards that side.
    """
    off = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        u, v = np.meshgrid(*2 * [(np.arange(float(SIDE_PX)) - 80) / FOCAL_PX])
        face = (np.abs(u) < 0.12) & (np.abs(v) < 0.15)
        depth = np.where(face, DEPTH_M / (1.0 - slope * u), np.nan)
        rays = np.stack([u, v, np.ones_like(u)], axis=-1)
        length = np.linalg.norm(rays, axis=-1)
        depth += rng.normal(0, noise_m, depth.shape) / length
        image = range_image(rays * depth[..., None], FOCAL_PX)
        edges = find_edges(image, local_planes(image))
        right = (edges.sides[:, 0] > 0.9) & (np.abs(edges.points[:, 1]) < 0.12 * DEPTH_M)
        point, noise = edges.points[right], edges.range_noise_m[right]
        claimed = np.linalg.norm(noise, axis=1)
        np.testing.assert_allclose(np.cross(noise, point), 0.0, atol=1e-6)
        true = DEPTH_M / (1.0 - slope * point[:, 0] / point[:, 2])
        far = (point[:, 2] - true) * np.linalg.norm(point, axis=1) / point[:, 2]
        off.append(np.sqrt(len(far)) * far.mean() / claimed.mean())
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.2
