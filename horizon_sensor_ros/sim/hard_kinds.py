"""Kinds of hard scenes: what each draws otherwise than a clouded planet by day from low orbit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging, Occluder
from horizon_sensor_ros.sim.poses import camera_from_fov

_WIDTH, _HEIGHT = 640, 480
_FOVS_RAD = (np.radians(50.0), np.radians(70.0))


@dataclass(frozen=True, eq=False)
class SceneDraft:
    """A scene before it is drawn; kinds change the parts that make them."""

    camera: Camera
    altitude_m: float
    scene: EarthScene
    imaging: tuple[Imaging, Imaging]
    aim_rad: tuple[float, float]  # angles of the cameras' axes above the limb
    sun_beside_camera: np.ndarray | None = None  # in the frame of camera 1: direction to the Sun
    moon_beside_camera: np.ndarray | None = None  # the same of camera 2, to the Moon
    sun_zenith_rad: float | None = None  # angle of the Sun off the craft's zenith

    def record(self, **changes: object) -> SceneDraft:
        """Return a draft with both cameras' imaging changed."""
        one, two = self.imaging
        return replace(
            self,
            imaging=(replace(one, **changes), replace(two, **changes)),  # type: ignore[arg-type]
        )

    def show(self, **changes: object) -> SceneDraft:
        """Return a draft with the scene changed."""
        return replace(self, scene=replace(self.scene, **changes))  # type: ignore[arg-type]


def plain_draft(rng: np.random.Generator) -> SceneDraft:
    """A clouded planet by day from low orbit, limb well in both frames."""
    scene = EarthScene(
        texture="clouds",
        texture_seed=int(rng.integers(2**31)),
        cloud_cover=float(rng.uniform(0.35, 0.75)),
        air_dn=float(rng.uniform(0.0, 130.0)),
        air_inside=float(rng.uniform(0.5, 1.0)),
    )
    imaging = Imaging(noise_dn=float(rng.uniform(1.0, 2.5)), background_dn=rng.uniform(2.0, 12.0))
    return SceneDraft(
        camera=camera_from_fov(_WIDTH, _HEIGHT, rng.uniform(*_FOVS_RAD)),
        altitude_m=float(np.exp(rng.uniform(np.log(300e3), np.log(1200e3)))),
        scene=scene,
        imaging=(imaging, imaging),
        aim_rad=(rng.uniform(-0.1, 0.25), rng.uniform(-0.1, 0.25)),
    )


def _in_frame(rng: np.random.Generator, camera: Camera, low: float, high: float) -> np.ndarray:
    """Direction of a random pixel between two shares of the frame's height, the top being 0."""
    px = [rng.uniform(0.1, 0.9) * camera.width, rng.uniform(low, high) * camera.height]
    return camera.rays(np.array([px]))[0]


def _flat(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    return draft.show(texture="uniform", air_dn=0.0, uniform_dn=float(rng.uniform(60.0, 240.0)))


def _clouds(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    draft = draft.show(air_dn=0.0)
    return replace(draft, sun_zenith_rad=rng.uniform(0.0, 0.6)) if rng.uniform() < 0.5 else draft


def _air(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    return replace(
        draft.show(air_dn=float(rng.uniform(60.0, 220.0))),
        altitude_m=float(rng.uniform(250e3, 600e3)),
    )


def _dim(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    return draft.record(gain=float(rng.uniform(0.15, 0.4)), noise_dn=float(rng.uniform(1.5, 2.5)))


def _saturated(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    return draft.record(gain=float(rng.uniform(2.0, 6.0)))


def _terminator(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    return replace(draft, sun_zenith_rad=float(rng.uniform(1.35, 1.95)))


def _sun(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    shown = draft.show(sun_dn=float(rng.uniform(400.0, 1500.0)), even_light=rng.uniform() < 0.5)
    return replace(shown, sun_beside_camera=_in_frame(rng, draft.camera, 0.02, 0.45))


def _flare(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    shown = draft.show(even_light=True).record(flare_dn=float(rng.uniform(20.0, 90.0)))
    return replace(shown, sun_beside_camera=_in_frame(rng, draft.camera, -0.4, 0.2))


def _moon(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    shown = draft.show(
        star_count=int(rng.integers(500, 4000)),
        star_seed=int(rng.integers(2**31)),
        moon_radius_rad=float(rng.choice([0.0045, 0.015])),
        even_light=True,
    )
    return replace(
        shown,
        moon_beside_camera=_in_frame(rng, draft.camera, 0.02, 0.5),
        sun_zenith_rad=float(rng.uniform(0.0, 1.3)),
    )


def _boom(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    """A bar across camera 1; in half of the scenes a corner of the craft in camera 2."""
    x0, x1 = rng.uniform(0.1, 0.9, 2) * _WIDTH
    half = rng.uniform(8.0, 40.0)
    bar = Occluder(
        (
            (x0 - half, -9.0),
            (x0 + half, -9.0),
            (x1 + half, _HEIGHT + 9.0),
            (x1 - half, _HEIGHT + 9.0),
        ),
        float(rng.uniform(30.0, 200.0)),
    )
    reach = rng.uniform(0.2, 0.5, 2) * (_WIDTH, _HEIGHT)
    side = _WIDTH if rng.uniform() < 0.5 else -9.0
    corner = Occluder(
        ((side, -9.0), (abs(side - reach[0]), -9.0), (side, reach[1])),
        float(rng.uniform(20.0, 160.0)),
    )
    one, two = draft.imaging
    extra = (corner,) if rng.uniform() < 0.5 else ()
    return replace(draft, imaging=(replace(one, occluders=(bar,)), replace(two, occluders=extra)))


def _lens(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    k1 = float(rng.uniform(-0.28, 0.1))
    if rng.uniform() < 0.7:
        distortion: tuple[float, ...] = (k1, -0.3 * k1, float(rng.uniform(-1e-3, 1e-3)), -8e-4, 0.0)
        return replace(draft, camera=replace(draft.camera, distortion=distortion))
    distortion = (0.1 * k1, -0.004, 0.002, 0.0)
    return replace(draft, camera=replace(draft.camera, model="equidistant", distortion=distortion))


def _wgs84(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    return draft.show(planet=Planet.wgs84())


def _high(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    return replace(draft, altitude_m=float(rng.uniform(2000e3, 6000e3)))


def _balloon(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    return replace(
        draft.show(air_dn=float(rng.uniform(80.0, 140.0))),
        altitude_m=float(rng.uniform(25e3, 40e3)),
    )


def _space(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    up = draft.aim_rad[0] + np.radians(60.0)
    return replace(draft.show(star_count=4000), aim_rad=(up, draft.aim_rad[1]))


def _earth(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    narrow = camera_from_fov(_WIDTH, _HEIGHT, np.radians(40.0))
    down = -np.radians(rng.uniform(28.0, 34.0))
    return replace(draft, camera=narrow, altitude_m=rng.uniform(300e3, 500e3), aim_rad=(down, 0.1))


def _night(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    shown = draft.show(star_count=3000, star_seed=int(rng.integers(2**31)))
    return replace(shown, sun_zenith_rad=float(rng.uniform(2.5, np.pi)))


def _city(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    return _night(draft, rng).show(city_dn=float(rng.uniform(150.0, 400.0)))


def _airglow(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    return _night(draft, rng).show(
        airglow_dn=float(rng.uniform(20.0, 80.0)),
        night_light=float(rng.choice([0.0, 0.5])),
        city_dn=float(rng.choice([0.0, 200.0])),
    )


def _moonlit(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    """Long exposures by moonlight: airglow above the limb, lamps, stars, stray light."""
    shown = _night(draft, rng).show(
        airglow_dn=float(rng.uniform(20.0, 80.0)),
        airglow_height_m=float(rng.uniform(85e3, 100e3)),
        night_light=float(rng.uniform(0.3, 0.7)),
        city_dn=float(rng.choice([0.0, 300.0])),
        star_count=10000,
    )
    return shown.record(
        noise_dn=float(rng.uniform(1.0, 2.5)),
        stray_dn=float(rng.uniform(0.0, 15.0)),
        stray_angle_rad=float(rng.uniform(-np.pi, np.pi)),
    )


def _hot_pixels(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    return draft.record(hot_pixels=int(rng.integers(100, 3000)))


def _vignetting(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    return draft.record(vignetting=float(rng.uniform(0.5, 0.9)))


def _jpeg(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    return draft.record(jpeg_quality=int(rng.integers(25, 80)))


def _banding(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    return draft.record(
        banding=float(rng.uniform(0.1, 0.4)), banding_period_px=float(rng.uniform(15.0, 200.0))
    )


def _daylight(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    """Air that scatters sunlight by its angle, which changes along every limb."""
    shown = draft.show(
        air_dn=float(rng.uniform(60.0, 200.0)), air_rayleigh=float(rng.uniform(0.3, 0.8))
    )
    return replace(shown, sun_zenith_rad=float(rng.uniform(0.0, 1.2)))


def _soft_corners(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    """Clouds without air, and a lens that blurs more away from its axis, as most do."""
    return draft.show(air_dn=0.0).record(
        psf_sigma_px=float(rng.uniform(0.5, 0.7)), corner_psf_px=float(rng.uniform(0.7, 1.1))
    )


def _low_sun(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    """Air that the Sun, high above to below the horizon, lights as it does ground: unevenly."""
    shown = draft.show(air_dn=float(rng.uniform(60.0, 220.0)), air_light="sine")
    return replace(
        shown,
        altitude_m=float(rng.uniform(250e3, 1000e3)),
        sun_zenith_rad=float(np.arccos(rng.uniform(-0.3, 1.0))),
    )


def _haze(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    """Air as thick as the Earth's, which hides the ground at the limb: red light to hazy blue."""
    return replace(
        _daylight(draft, rng).show(
            air_dn=float(rng.uniform(40.0, 170.0)),
            air_depth=float(np.exp(rng.uniform(np.log(3.0), np.log(25.0)))),
            air_scale_height_m=float(rng.uniform(6500.0, 9000.0)),
        ),
        altitude_m=float(np.exp(rng.uniform(np.log(300e3), np.log(800e3)))),
    )


def _balloon_haze(draft: SceneDraft, rng: np.random.Generator) -> SceneDraft:
    """The same from a balloon, within that air."""
    return replace(_haze(draft, rng), altitude_m=float(rng.uniform(25e3, 40e3)))


KINDS: dict[str, Callable[[SceneDraft, np.random.Generator], SceneDraft]] = {
    "flat": _flat,
    "clouds": _clouds,
    "air": _air,
    "dim": _dim,
    "terminator": _terminator,
    "sun": _sun,
    "moon": _moon,
    "boom": _boom,
    "lens": _lens,
    "wgs84": _wgs84,
    "high": _high,
    "balloon": _balloon,
    "space": _space,
    "night": _night,
    "earth": _earth,
    "city": _city,
    "airglow": _airglow,
    "moonlit": _moonlit,
    "flare": _flare,
    "hot_pixels": _hot_pixels,
    "vignetting": _vignetting,
    "jpeg": _jpeg,
    "banding": _banding,
    "saturated": _saturated,
}
# Some are drawn only when they are named, and not in turn with the others.
ALL_KINDS = KINDS | {
    "daylight": _daylight,
    "haze": _haze,
    "balloon_haze": _balloon_haze,
    "low_sun": _low_sun,
    "soft_corners": _soft_corners,
}
