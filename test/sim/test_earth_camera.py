from dataclasses import replace

import cv2
import numpy as np
import pytest
from limb_measurement import half_height_crossings, inside_frame

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.earth_camera import SimFrame, render, render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging, Occluder, unit_vector
from horizon_sensor_ros.sim.poses import pose_from_attitude, rot_from_axis, side_views

RADIUS = 6371e3
PINHOLE = Camera(320, 240, 260.0, 260.0, 159.5, 119.5)
LENSES = {
    "pinhole": PINHOLE,
    "plumb_bob": Camera(
        320, 240, 230.0, 231.0, 158.0, 121.0, "plumb_bob", (-0.22, 0.06, 1e-3, -8e-4)
    ),
    "equidistant": Camera(
        320, 240, 200.0, 200.0, 159.5, 119.5, "equidistant", (0.01, -0.003, 0, 0)
    ),
}
CLEAN = Imaging(noise_dn=0.0, bits=16)


def looking_at_limb(
    planet: Planet, altitude_m: float, above_rad: float = 0.05, turn_rad: float = 0.3
) -> tuple[np.ndarray, np.ndarray]:
    """Camera over latitude 40 deg, axis a little above the limb; upright but for its turn."""
    position = planet.ecef_from_geodetic(0.7, -1.1, altitude_m)
    nadir = planet.nadir_ecef(position)
    side = np.cross(nadir, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    tilt = planet.rho_from_altitude(altitude_m) + above_rad
    z = np.cos(tilt) * nadir + np.sin(tilt) * side
    y = np.sin(tilt) * nadir - np.cos(tilt) * side
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.stack([np.cross(y, z), y, z], axis=1) @ turn, position


def draw(
    scene: EarthScene | None = None,
    imaging: Imaging = CLEAN,
    camera: Camera = PINHOLE,
    altitude_m: float = 800e3,
    seed: int = 0,
    turn_rad: float = 0.3,
) -> SimFrame:
    scene = EarthScene() if scene is None else scene
    rot, position = looking_at_limb(scene.planet, altitude_m, turn_rad=turn_rad)
    return render(camera, rot, position, scene, np.random.default_rng(seed), imaging=imaging)


def grey(frame: SimFrame) -> np.ndarray:
    """Image in DN of 8 bits."""
    full_scale = 255.0 if frame.image.dtype == np.uint8 else 65535.0
    return frame.image * (255.0 / full_scale)


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("planet", [Planet(), Planet.wgs84(), Planet(limb_height_m=12e3)])
@pytest.mark.parametrize("altitude_m", [300e3, 3000e3])
def test_limb_is_drawn_where_truth_says(lens: str, planet: Planet, altitude_m: float) -> None:
    frame = draw(EarthScene(planet=planet), camera=LENSES[lens], altitude_m=altitude_m)
    limb = frame.truth.limb
    keep = inside_frame(limb.px, frame.image.shape, 8.0)
    error = half_height_crossings(grey(frame), limb.px[keep], limb.normal_px[keep])
    assert keep.sum() > 300
    # the PSF's own sampling makes single crossings wander; the limb as a whole must not
    assert abs(np.median(error)) < 0.004
    assert np.percentile(np.abs(error), 95) < 0.05


def test_limb_pixels_hold_the_exact_share_of_the_planet() -> None:
    dark = Imaging(psf_sigma_px=0.0, noise_dn=0.0, background_dn=0.0, bits=16)
    scene = EarthScene(uniform_dn=200.0)
    frame = draw(scene, dark, turn_rad=0.0)
    truth = frame.truth
    light = grey(frame) / 200.0
    rng = np.random.default_rng(1)
    partly = np.argwhere((light > 0.02) & (light < 0.98))
    sub = (np.arange(60) + 0.5) / 60.0 - 0.5
    for y, x in rng.choice(partly, 40, replace=False):
        px_x, px_y = np.meshgrid(x + sub, y + sub)
        rays = np.stack(
            [(px_x - PINHOLE.cx) / PINHOLE.fx, (px_y - PINHOLE.cy) / PINHOLE.fy, np.ones((60, 60))],
            axis=-1,
        )
        # a line misses a ball whose centre is farther from it than the radius
        to_centre = truth.nadir_cam * np.linalg.norm(truth.position_ecef_m)
        miss = np.linalg.norm(np.cross(rays, to_centre), axis=-1) / np.linalg.norm(rays, axis=-1)
        assert light[y, x] == pytest.approx(np.mean(miss < RADIUS), abs=0.004)


def test_truth_curve_grazes_the_ellipsoid() -> None:
    planet = Planet.wgs84(limb_height_m=5e3)
    frame = draw(EarthScene(planet=planet))
    truth = frame.truth
    rays = PINHOLE.rays(truth.limb.px) @ truth.rot_world_from_cam.T
    weights = 1.0 / np.array([6378137.0 + 5e3, 6378137.0 + 5e3, 6356752.314 + 5e3]) ** 2
    p = truth.position_ecef_m
    a, b, c = rays**2 @ weights, rays @ (weights * p), weights @ p**2 - 1.0
    assert np.abs(b * b / (a * c) - 1.0).max() < 1e-9
    # normals: unit, across the curve, away from the planet
    along = np.diff(truth.limb.px, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    normal = truth.limb.normal_px
    assert np.abs(np.linalg.norm(normal, axis=1) - 1.0).max() < 1e-12
    assert np.abs(np.sum(along * normal[1:], axis=1)).max() < 1e-2
    outside = PINHOLE.rays(truth.limb.px + normal)
    inside = PINHOLE.rays(truth.limb.px - normal)
    assert np.all(outside @ truth.nadir_cam < inside @ truth.nadir_cam)


def test_truth_of_the_pose_follows_paper_c() -> None:
    roll, pitch, altitude = 0.3, -0.25, 700e3
    rot, position = pose_from_attitude(altitude, roll, pitch, 0.8, latitude_rad=0.5)
    views = side_views(PINHOLE)
    frames = render_views(views, rot, position, EarthScene(), np.random.default_rng(0))
    nadir = [-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)]
    for view, frame in zip(views, frames, strict=True):
        truth = frame.truth
        np.testing.assert_allclose(truth.nadir_base, nadir, atol=1e-12)
        np.testing.assert_allclose(view.rot_base_from_cam @ truth.nadir_cam, nadir, atol=1e-12)
        np.testing.assert_allclose(truth.rot_world_from_base, rot, atol=1e-12)
        assert truth.altitude_m == pytest.approx(altitude, abs=1e-3)
        assert np.sin(truth.rho_rad) == pytest.approx(RADIUS / (RADIUS + altitude), abs=1e-12)
        limb = view.camera.rays(truth.limb.px)
        np.testing.assert_allclose(limb @ truth.nadir_cam, np.cos(truth.rho_rad), atol=1e-9)


def test_geodetic_truth_differs_from_geocentric_on_the_ellipsoid_only() -> None:
    on_sphere = draw().truth
    np.testing.assert_allclose(on_sphere.geodetic_nadir_base, on_sphere.nadir_base, atol=1e-12)
    truth = draw(EarthScene(planet=Planet.wgs84())).truth
    latitude = 0.7
    east_of_up = [np.cos(latitude) * np.cos(1.1), -np.cos(latitude) * np.sin(1.1), np.sin(latitude)]
    np.testing.assert_allclose(
        truth.rot_world_from_base @ truth.geodetic_nadir_base, -np.array(east_of_up), atol=1e-9
    )
    apart = np.degrees(np.arccos(truth.nadir_base @ truth.geodetic_nadir_base))
    assert 0.15 < apart < 0.2


def test_the_same_seed_draws_the_same_frame() -> None:
    scene = EarthScene(texture="clouds", texture_seed=3, air_dn=80.0, star_count=2000)
    noisy = Imaging(noise_dn=3.0, shot_noise_dn=0.05, hot_pixels=20, banding=0.1)
    one, two, other = (draw(scene, noisy, seed=seed) for seed in (5, 5, 6))
    assert np.array_equal(one.image, two.image)
    assert not np.array_equal(one.image, other.image)


def test_clouds_stay_on_the_ground_between_frames() -> None:
    """A ground point seen from two places has one brightness."""
    scene = EarthScene(texture="clouds", texture_seed=3)
    imaging = Imaging(noise_dn=0.0, psf_sigma_px=0.0, bits=16)
    seen = []
    ground = None
    for pitch in (-0.6, -0.45):
        rot, position = pose_from_attitude(900e3, 0.0, pitch, latitude_rad=0.2)
        view = side_views(PINHOLE)[0]
        rot_cam = rot @ view.rot_base_from_cam
        frame = render(PINHOLE, rot_cam, position, scene, np.random.default_rng(0), imaging=imaging)
        if ground is None:
            x, y = np.meshgrid(np.arange(60, 260, 3.0), np.arange(180, 236, 3.0))
            px = np.stack([x.ravel(), y.ravel()], axis=1)
            rays = PINHOLE.rays(px) @ rot_cam.T
            along = -(rays @ position)
            inside = along**2 - position @ position + RADIUS**2
            rays, along, inside = rays[inside > 0], along[inside > 0], inside[inside > 0]
            ground = position + (along - np.sqrt(inside))[:, None] * rays
        px = PINHOLE.pixels((ground - position) @ rot_cam)
        x, y = np.rint(px).astype(int).T
        ok = (x >= 0) & (x < 320) & (y >= 0) & (y < 240)
        seen.append(np.where(ok, grey(frame)[np.clip(y, 0, 239), np.clip(x, 0, 319)], np.nan))
    both = np.isfinite(seen[0] + seen[1])
    assert both.sum() > 200
    assert np.std(seen[0][both]) > 20.0
    assert np.corrcoef(seen[0][both], seen[1][both])[0, 1] > 0.97


def test_air_fades_with_its_scale_height() -> None:
    scene = EarthScene(uniform_dn=100.0, air_dn=120.0, air_scale_height_m=20e3)
    frame = draw(scene, Imaging(psf_sigma_px=0.0, noise_dn=0.0, background_dn=0.0, bits=16))
    truth = frame.truth
    x, y = np.meshgrid(np.arange(320.0), np.arange(240.0))
    rays = PINHOLE.rays(np.stack([x.ravel(), y.ravel()], axis=1))
    sine = np.linalg.norm(np.cross(rays, truth.nadir_cam), axis=1)
    height = np.linalg.norm(truth.position_ecef_m) * sine - RADIUS
    light = grey(frame).ravel()
    beside = (height > 10e3) & (height < 60e3) & (rays @ truth.nadir_cam < np.cos(truth.rho_rad))
    slope, level = np.polyfit(height[beside], np.log(light[beside]), 1)
    assert -1.0 / slope == pytest.approx(20e3, rel=0.01)
    assert np.exp(level) == pytest.approx(120.0, rel=0.01)


def test_thick_air_absorbs_what_lies_behind_it() -> None:
    clear = EarthScene(uniform_dn=120.0, air_dn=100.0, air_scale_height_m=20e3)
    exact = Imaging(psf_sigma_px=0.0, noise_dn=0.0, background_dn=0.0, bits=16)
    glowing, thick = (draw(replace(clear, air_depth=depth), exact) for depth in (0.0, 6.0))
    truth = thick.truth
    x, y = np.meshgrid(np.arange(320.0), np.arange(240.0))
    rays = PINHOLE.rays(np.stack([x.ravel(), y.ravel()], axis=1))
    sine = np.linalg.norm(np.cross(rays, truth.nadir_cam), axis=1)
    height = np.linalg.norm(truth.position_ecef_m) * sine - RADIUS
    outside = rays @ truth.nadir_cam < np.cos(truth.rho_rad)
    light = grey(thick).ravel()
    beside = outside & (height > 5e3) & (height < 100e3)
    law = 100.0 * (1.0 - np.exp(-6.0 * np.exp(-height[beside] / 20e3)))
    np.testing.assert_allclose(light[beside], law, atol=0.5)
    # In front of the ground lies half of the air that a grazing ray goes through, and less.
    beneath = ~outside & (height > -60e3) & (height < -5e3)
    column = (grey(glowing).ravel()[beneath] - 120.0) / 100.0
    through = np.exp(-6.0 * column)
    law = 120.0 * through + 100.0 * (1.0 - through)
    np.testing.assert_allclose(light[beneath], law, atol=1.0)
    with pytest.raises(ValueError, match="air_depth must not be negative, got -1"):
        EarthScene(air_depth=-1.0)


def test_air_scatters_sunlight_by_rayleighs_law() -> None:
    rot, position = looking_at_limb(Planet(), 800e3, turn_rad=0.0)
    zenith = position / np.linalg.norm(position)
    sun = unit_vector(zenith + 0.5 * rot[:, 0] - 0.3 * rot[:, 1])
    clear = Imaging(psf_sigma_px=0.0, noise_dn=0.0, background_dn=0.0, bits=16)
    scene = EarthScene(uniform_dn=0.0, air_dn=120.0, air_scale_height_m=20e3, sun_direction=sun)
    even, scattered = (
        render(PINHOLE, rot, position, each, np.random.default_rng(0), imaging=clear)
        for each in (scene, replace(scene, air_rayleigh=1.0))
    )
    x, y = np.meshgrid(np.arange(320.0), np.arange(240.0))
    rays = PINHOLE.rays(np.stack([x.ravel(), y.ravel()], axis=1))
    lit = (grey(even).ravel() > 60.0) & (rays @ even.truth.nadir_cam < np.cos(even.truth.rho_rad))
    law = 0.75 * (1.0 + np.square(rays @ rot.T @ np.array(sun)))
    found = (grey(scattered).ravel() / np.maximum(grey(even).ravel(), 1.0))[lit]
    assert np.ptp(law[lit]) > 0.05
    np.testing.assert_allclose(found, law[lit], atol=0.02)


def test_sunlight_leaves_the_night_side_dark_and_the_truth_knows() -> None:
    rot, position = looking_at_limb(Planet(), 800e3, turn_rad=0.0)
    mid = rot @ PINHOLE.rays(np.array([[159.5, 119.5]]))[0]
    limb_point = position + mid * np.sqrt(position @ position - RADIUS**2)
    across = rot[:, 0]  # along the limb, in the image from left to right
    sun = unit_vector(across - limb_point * (across @ limb_point) / (limb_point @ limb_point))
    scene = EarthScene(sun_direction=sun)
    frame = render(PINHOLE, rot, position, scene, np.random.default_rng(0), imaging=CLEAN)
    limb = frame.truth.limb
    lit = limb.visible(12.0)
    right = limb.px[:, 0] > 200.0
    left = limb.px[:, 0] < 100.0
    assert lit[right].all()
    assert not lit[left].any()
    assert 100.0 < limb.visible_length_px(12.0) < 250.0
    everywhere = render(
        PINHOLE,
        rot,
        position,
        EarthScene(sun_direction=sun, even_light=True),
        np.random.default_rng(0),
        imaging=CLEAN,
    )
    assert everywhere.truth.limb.visible(12.0).all()


def test_sun_is_drawn_where_it_is_unless_hidden() -> None:
    rot, position = looking_at_limb(Planet(), 800e3, turn_rad=0.0)
    above, below = np.array([[200.0, 40.0], [200.0, 200.0]])

    def sunny(px: np.ndarray, imaging: Imaging = CLEAN) -> np.ndarray:
        sun = unit_vector(rot @ PINHOLE.rays(px[None])[0])
        scene = EarthScene(sun_direction=sun, even_light=True, sun_dn=600.0, uniform_dn=80.0)
        return grey(
            render(PINHOLE, rot, position, scene, np.random.default_rng(0), imaging=imaging)
        )

    image = sunny(above)
    assert image[40, 200] == 255.0
    assert image[40, 20] > image[60, 20] + 10.0  # the streak along the row
    assert sunny(below).max() < 100.0  # behind the planet
    cover = Occluder(((180.0, 20.0), (220.0, 20.0), (220.0, 60.0), (180.0, 60.0)), 30.0)
    assert sunny(above, Imaging(noise_dn=0.0, bits=16, occluders=(cover,))).max() < 100.0
    ghosts = sunny(above, Imaging(noise_dn=0.0, bits=16, flare_dn=60.0)) - image
    assert 20.0 < ghosts.max() < 70.0


def test_moon_shows_the_side_towards_the_sun() -> None:
    rot, position = looking_at_limb(Planet(), 800e3, turn_rad=0.0)
    centre = np.array([160.0, 50.0])
    moon = unit_vector(rot @ PINHOLE.rays(centre[None])[0])
    scene = EarthScene(
        moon_direction=moon,
        moon_radius_rad=0.04,
        moon_dn=180.0,
        sun_direction=unit_vector(rot[:, 0]),
    )
    image = grey(render(PINHOLE, rot, position, scene, np.random.default_rng(0), imaging=CLEAN))
    assert image[50, 166] > 150.0
    assert image[50, 154] < 10.0
    full = EarthScene(moon_direction=moon, moon_radius_rad=0.04, moon_dn=180.0)
    image = grey(render(PINHOLE, rot, position, full, np.random.default_rng(0), imaging=CLEAN))
    area = np.sum(image[30:70, 140:180] - 4.0) / 180.0
    stretch = np.hypot(1.0, (119.5 - 50.0) / 260.0) ** 3  # of a pinhole image, off its axis
    assert area == pytest.approx(np.pi * (0.04 * 260.0) ** 2 * stretch, rel=0.03)


def test_stars_are_fixed_in_the_world_and_behind_the_planet() -> None:
    scene = EarthScene(star_count=20000, star_seed=4, uniform_dn=0.0)
    frame = draw(scene)
    assert np.count_nonzero(grey(frame) > 20.0) > 50
    rays = PINHOLE.rays(np.argwhere(grey(frame) > 20.0)[:, ::-1].astype(float))
    assert np.all(rays @ frame.truth.nadir_cam < np.cos(frame.truth.rho_rad - 0.01))


def test_parts_of_the_craft_hide_the_limb() -> None:
    bar = Occluder(((150.0, -5.0), (170.0, -5.0), (170.0, 250.0), (150.0, 250.0)), 90.0)
    frame = draw(imaging=Imaging(noise_dn=0.0, bits=16, occluders=(bar,)))
    assert grey(frame)[:, 153:167] == pytest.approx(94.0, abs=0.1)
    limb = frame.truth.limb
    behind = (limb.px[:, 0] > 150.0) & (limb.px[:, 0] < 170.0)
    assert behind.any()
    assert not limb.visible(10.0)[behind].any()
    clear = (limb.px[:, 0] < 140.0) | (limb.px[:, 0] > 180.0)
    assert limb.visible(10.0)[clear].all()


def test_night_city_lights_and_airglow() -> None:
    dark = unit_vector(looking_at_limb(Planet(), 800e3)[1] * -1.0)
    night = draw(EarthScene(texture="clouds", sun_direction=dark))
    assert grey(night).max() < 6.0
    assert night.truth.limb.visible_length_px(5.0) == 0.0
    city = draw(EarthScene(texture="clouds", sun_direction=dark, city_dn=300.0))
    assert grey(city).max() > 40.0
    glow = draw(EarthScene(sun_direction=dark, airglow_dn=60.0, airglow_height_m=95e3))
    assert not glow.truth.limb.visible(5.0).any()
    brightest = np.argwhere(grey(glow) > 0.8 * grey(glow).max())[:, ::-1].astype(float)
    sine = np.linalg.norm(np.cross(PINHOLE.rays(brightest), glow.truth.nadir_cam), axis=1)
    height = np.linalg.norm(glow.truth.position_ecef_m) * sine - RADIUS
    assert np.median(height) == pytest.approx(95e3, abs=8e3)
    limb = glow.truth.limb
    below, above = (
        cv2.remap(
            grey(glow).astype(np.float32),
            *(limb.px + offset * limb.normal_px).astype(np.float32).T[:, None],
            cv2.INTER_LINEAR,
        )
        for offset in (-2.0, 2.0)
    )
    background = Imaging().background_dn
    # The ground hides the far half of the layer, which fades downwards besides.
    ratio = np.median(below - background) / np.median(above - background)
    assert 0.38 < ratio < 0.5


def test_limb_height_raises_the_limb_but_not_the_altitude() -> None:
    low, high = draw().truth, draw(EarthScene(planet=Planet(limb_height_m=10e3))).truth
    assert low.altitude_m == pytest.approx(high.altitude_m)
    expected = np.arcsin((RADIUS + 10e3) / (RADIUS + 800e3)) - np.arcsin(RADIUS / (RADIUS + 800e3))
    assert high.rho_rad - low.rho_rad == pytest.approx(expected, abs=1e-9)


def test_no_limb_in_the_frame() -> None:
    position = np.array([7000e3, 0.0, 0.0])
    up = render(
        PINHOLE,
        rot_from_axis(np.array([1.0, 0, 0])),
        position,
        EarthScene(),
        np.random.default_rng(0),
    )
    assert up.truth.limb.px.shape == (0, 2)
    assert up.truth.limb.visible_length_px(1.0) == 0.0
    assert up.image.mean() < 6.0
    down = render(
        PINHOLE,
        rot_from_axis(np.array([-1.0, 0, 0])),
        position,
        EarthScene(),
        np.random.default_rng(0),
    )
    assert len(down.truth.limb.px) == 0
    assert down.image.mean() > 190.0


def test_pixels_outside_the_lens_field_are_dark() -> None:
    camera = Camera(320, 240, 150.0, 150.0, 159.5, 119.5, "equidistant", (-0.3, 0.0, 0.0, 0.0))
    corner = np.array([[0.0, 0.0]])
    assert np.isnan(camera.rays(corner)).all()
    rot = rot_from_axis(np.array([-1.0, 0.0, 0.0]))
    frame = render(
        camera,
        rot,
        np.array([6600e3, 0.0, 0.0]),
        EarthScene(),
        np.random.default_rng(0),
        imaging=CLEAN,
    )
    assert grey(frame)[0, 0] == pytest.approx(4.0, abs=0.1)
    assert grey(frame)[120, 160] == pytest.approx(199.0, abs=0.1)


def test_wrong_arguments_are_named() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="position_ecef_m"):
        render(PINHOLE, np.eye(3), np.array([6e6, 0.0, 0.0]), EarthScene(), rng)
    with pytest.raises(ValueError, match="imaging"):
        render_views(
            side_views(PINHOLE),
            np.eye(3),
            np.array([7e6, 0, 0]),
            EarthScene(),
            rng,
            imaging=[CLEAN],
        )
    for wrong in ({"texture": "stripes"}, {"cloud_cover": 1.0}, {"air_scale_height_m": 0.0}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            EarthScene(**wrong)
    for wrong in ({"bits": 7}, {"noise_dn": -1.0}, {"jpeg_quality": 50, "bits": 12}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            Imaging(**wrong)
    with pytest.raises(ValueError, match="corners_px"):
        Occluder(((0.0, 0.0), (1.0, 1.0)))
    with pytest.raises(ValueError, match="vector"):
        unit_vector([0.0, 0.0, 0.0])
