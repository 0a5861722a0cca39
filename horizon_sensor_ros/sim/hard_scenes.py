"""Random hard scenes of every kind for two perpendicular 640 x 480 cameras.

What is to be expected of a scene is computed from its truth: how much lit, unhidden limb each frame
shows, not which kind it is meant to be.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.earth_camera import SimFrame, render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging, Occluder, unit_vector
from horizon_sensor_ros.sim.poses import (
    ROT_BODY_FROM_FORWARD_CAMERA,
    ROT_BODY_FROM_RIGHT_CAMERA,
    camera_from_fov,
    random_direction,
    side_views,
)

FloatArray = NDArray[np.float64]

_WIDTH, _HEIGHT = 640, 480
_FOVS_RAD = (np.radians(50.0), np.radians(70.0))
_CLEAR_LIMB_PX = 200.0  # visible limb from which a camera is held to have a limb ...
_NO_LIMB_PX = 40.0  # ... and below which it is held to have none
_LEAST_STEP_DN = 12.0  # a visible limb is this much brighter than the sky,
_LEAST_STEP_SIGMA = 4.0  # and that many times the noise


@dataclass(frozen=True, eq=False)
class HardScene:
    """A scene, its frames (one a view) and what is to be expected of them.

    expect : "fix" where at least one camera shows a clear limb, "none" where no camera shows any,
    "either" between. limb_cameras, blind_cameras : names of those with a clear limb, and with none.
    """

    name: str
    kind: str
    views: tuple[CameraView, ...]
    frames: tuple[SimFrame, ...]
    scene: EarthScene
    imaging: tuple[Imaging, ...]
    expect: str
    limb_cameras: tuple[str, ...]
    blind_cameras: tuple[str, ...]

    def redrawn(self, scene: EarthScene, rng: np.random.Generator) -> tuple[SimFrame, ...]:
        """The frames of another world, by the same cameras at the same place."""
        truth = self.frames[0].truth
        rot, position = truth.rot_world_from_base, truth.position_ecef_m
        return render_views(self.views, rot, position, scene, rng, imaging=self.imaging)


@dataclass(frozen=True, eq=False)
class _Draft:
    """A scene before it is drawn; kinds change the parts that make them."""

    camera: Camera
    altitude_m: float
    scene: EarthScene
    imaging: tuple[Imaging, Imaging]
    aim_rad: tuple[float, float]  # angles of the cameras' axes above the limb
    sun_beside_camera: FloatArray | None = None  # in the frame of camera 1: direction to the Sun
    moon_beside_camera: FloatArray | None = None  # the same of camera 2, to the Moon
    sun_zenith_rad: float | None = None  # angle of the Sun off the craft's zenith

    def record(self, **changes: object) -> _Draft:
        """Return a draft with both cameras' imaging changed."""
        one, two = self.imaging
        return replace(
            self,
            imaging=(replace(one, **changes), replace(two, **changes)),  # type: ignore[arg-type]
        )

    def show(self, **changes: object) -> _Draft:
        """Return a draft with the scene changed."""
        return replace(self, scene=replace(self.scene, **changes))  # type: ignore[arg-type]


def hard_scenes(n: int, seed: int = 0, kinds: tuple[str, ...] | None = None) -> Iterator[HardScene]:
    """Draw n scenes, the kinds in turn; scene i of a seed is the same whatever n is.

    kinds : of `KINDS`, default all of these, or of `ALL_KINDS`; ValueError for others.
    """
    kinds = tuple(KINDS) if kinds is None else kinds
    _check(kinds)
    return (hard_scene(kinds[i % len(kinds)], i, seed) for i in range(n))


def _check(kinds: tuple[str, ...]) -> None:
    unknown = set(kinds) - set(ALL_KINDS)
    if unknown:
        raise ValueError(f"unknown kinds {sorted(unknown)}; known are {', '.join(ALL_KINDS)}")


def hard_scene(kind: str, i: int, seed: int = 0) -> HardScene:
    """Draw scene i of a seed alone. kind : as of `hard_scenes`."""
    _check((kind,))
    rng = np.random.default_rng([seed, i, 0x4A8D])
    draft = ALL_KINDS[kind](_plain(rng), rng)
    planet = draft.scene.planet
    nadir_body = _nadir_body(draft, planet)
    rot_world_from_body, position = _place(rng, nadir_body, draft.altitude_m, planet)
    scene = _light(rng, draft, rot_world_from_body, position)
    views = side_views(draft.camera)
    frames = render_views(views, rot_world_from_body, position, scene, rng, imaging=draft.imaging)
    visible = [
        frame.truth.limb.visible_length_px(
            max(_LEAST_STEP_DN, _LEAST_STEP_SIGMA * imaging.noise_dn)
        )
        for frame, imaging in zip(frames, draft.imaging, strict=True)
    ]
    limb = tuple(v.name for v, px in zip(views, visible, strict=True) if px >= _CLEAR_LIMB_PX)
    blind = tuple(v.name for v, px in zip(views, visible, strict=True) if px < _NO_LIMB_PX)
    expect = "fix" if limb else "none" if len(blind) == len(views) else "either"
    return HardScene(
        name=f"{kind}{i}",
        kind=kind,
        views=views,
        frames=frames,
        scene=scene,
        imaging=draft.imaging,
        expect=expect,
        limb_cameras=limb,
        blind_cameras=blind,
    )


def _plain(rng: np.random.Generator) -> _Draft:
    """A clouded planet by day from low orbit, limb well in both frames."""
    scene = EarthScene(
        texture="clouds",
        texture_seed=int(rng.integers(2**31)),
        cloud_cover=float(rng.uniform(0.35, 0.75)),
        air_dn=float(rng.uniform(0.0, 130.0)),
        air_inside=float(rng.uniform(0.5, 1.0)),
    )
    imaging = Imaging(noise_dn=float(rng.uniform(1.0, 2.5)), background_dn=rng.uniform(2.0, 12.0))
    return _Draft(
        camera=camera_from_fov(_WIDTH, _HEIGHT, rng.uniform(*_FOVS_RAD)),
        altitude_m=float(np.exp(rng.uniform(np.log(300e3), np.log(1200e3)))),
        scene=scene,
        imaging=(imaging, imaging),
        aim_rad=(rng.uniform(-0.1, 0.25), rng.uniform(-0.1, 0.25)),
    )


def _nadir_body(draft: _Draft, planet: Planet) -> FloatArray:
    """Nadir in the body frame, so that the cameras look `aim_rad` above the limb where possible."""
    rho = planet.rho_from_altitude(draft.altitude_m)
    x, y = (np.cos(rho + aim) for aim in draft.aim_rad)
    # two perpendicular axes cannot both lie closer than 45 deg to nadir
    excess = np.hypot(x, y) / np.sin(np.radians(75.0))
    if excess > 1.0:
        x, y = x / excess, y / excess
    return np.array([x, y, np.sqrt(1.0 - x * x - y * y)])


def _place(
    rng: np.random.Generator, nadir_body: FloatArray, altitude_m: float, planet: Planet
) -> tuple[FloatArray, FloatArray]:
    """Random place over the planet, and an attitude there with that nadir and any heading."""
    latitude = float(np.arcsin(rng.uniform(-1.0, 1.0)))
    position = planet.ecef_from_geodetic(latitude, float(rng.uniform(-np.pi, np.pi)), altitude_m)
    nadir = planet.nadir_ecef(position)
    return _frame(nadir, random_direction(rng)) @ _frame(nadir_body, np.eye(3)[0]).T, position


def _frame(z: FloatArray, towards: FloatArray) -> FloatArray:
    """Orthonormal columns with the last along z and the first as near to a direction as it goes."""
    x = towards - z * (towards @ z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _light(
    rng: np.random.Generator, draft: _Draft, rot_world_from_body: FloatArray, position: FloatArray
) -> EarthScene:
    """Place Sun and Moon in the world."""
    scene = draft.scene
    zenith = position / np.linalg.norm(position)
    if draft.sun_beside_camera is not None:
        sun = rot_world_from_body @ ROT_BODY_FROM_FORWARD_CAMERA @ draft.sun_beside_camera
        scene = replace(scene, sun_direction=unit_vector(sun))
    elif draft.sun_zenith_rad is not None:
        across = np.cross(zenith, random_direction(rng))
        across /= np.linalg.norm(across)
        angle = draft.sun_zenith_rad
        scene = replace(
            scene, sun_direction=unit_vector(np.cos(angle) * zenith + np.sin(angle) * across)
        )
    if draft.moon_beside_camera is not None:
        moon = rot_world_from_body @ ROT_BODY_FROM_RIGHT_CAMERA @ draft.moon_beside_camera
        scene = replace(scene, moon_direction=unit_vector(moon))
    return scene


def _in_frame(rng: np.random.Generator, camera: Camera, low: float, high: float) -> FloatArray:
    """Direction of a random pixel between two shares of the frame's height, the top being 0."""
    px = [rng.uniform(0.1, 0.9) * camera.width, rng.uniform(low, high) * camera.height]
    return camera.rays(np.array([px]))[0]


def _flat(draft: _Draft, rng: np.random.Generator) -> _Draft:
    return draft.show(texture="uniform", air_dn=0.0, uniform_dn=float(rng.uniform(60.0, 240.0)))


def _clouds(draft: _Draft, rng: np.random.Generator) -> _Draft:
    draft = draft.show(air_dn=0.0)
    return replace(draft, sun_zenith_rad=rng.uniform(0.0, 0.6)) if rng.uniform() < 0.5 else draft


def _air(draft: _Draft, rng: np.random.Generator) -> _Draft:
    return replace(
        draft.show(air_dn=float(rng.uniform(60.0, 220.0))),
        altitude_m=float(rng.uniform(250e3, 600e3)),
    )


def _dim(draft: _Draft, rng: np.random.Generator) -> _Draft:
    return draft.record(gain=float(rng.uniform(0.15, 0.4)), noise_dn=float(rng.uniform(1.5, 2.5)))


def _saturated(draft: _Draft, rng: np.random.Generator) -> _Draft:
    return draft.record(gain=float(rng.uniform(2.0, 6.0)))


def _terminator(draft: _Draft, rng: np.random.Generator) -> _Draft:
    return replace(draft, sun_zenith_rad=float(rng.uniform(1.35, 1.95)))


def _sun(draft: _Draft, rng: np.random.Generator) -> _Draft:
    shown = draft.show(sun_dn=float(rng.uniform(400.0, 1500.0)), even_light=rng.uniform() < 0.5)
    return replace(shown, sun_beside_camera=_in_frame(rng, draft.camera, 0.02, 0.45))


def _flare(draft: _Draft, rng: np.random.Generator) -> _Draft:
    shown = draft.show(even_light=True).record(flare_dn=float(rng.uniform(20.0, 90.0)))
    return replace(shown, sun_beside_camera=_in_frame(rng, draft.camera, -0.4, 0.2))


def _moon(draft: _Draft, rng: np.random.Generator) -> _Draft:
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


def _boom(draft: _Draft, rng: np.random.Generator) -> _Draft:
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


def _lens(draft: _Draft, rng: np.random.Generator) -> _Draft:
    k1 = float(rng.uniform(-0.28, 0.1))
    if rng.uniform() < 0.7:
        distortion: tuple[float, ...] = (k1, -0.3 * k1, float(rng.uniform(-1e-3, 1e-3)), -8e-4, 0.0)
        return replace(draft, camera=replace(draft.camera, distortion=distortion))
    distortion = (0.1 * k1, -0.004, 0.002, 0.0)
    return replace(draft, camera=replace(draft.camera, model="equidistant", distortion=distortion))


def _wgs84(draft: _Draft, rng: np.random.Generator) -> _Draft:
    return draft.show(planet=Planet.wgs84())


def _high(draft: _Draft, rng: np.random.Generator) -> _Draft:
    return replace(draft, altitude_m=float(rng.uniform(2000e3, 6000e3)))


def _balloon(draft: _Draft, rng: np.random.Generator) -> _Draft:
    return replace(
        draft.show(air_dn=float(rng.uniform(80.0, 140.0))),
        altitude_m=float(rng.uniform(25e3, 40e3)),
    )


def _space(draft: _Draft, rng: np.random.Generator) -> _Draft:
    up = draft.aim_rad[0] + np.radians(60.0)
    return replace(draft.show(star_count=4000), aim_rad=(up, draft.aim_rad[1]))


def _earth(draft: _Draft, rng: np.random.Generator) -> _Draft:
    narrow = camera_from_fov(_WIDTH, _HEIGHT, np.radians(40.0))
    down = -np.radians(rng.uniform(28.0, 34.0))
    return replace(draft, camera=narrow, altitude_m=rng.uniform(300e3, 500e3), aim_rad=(down, 0.1))


def _night(draft: _Draft, rng: np.random.Generator) -> _Draft:
    shown = draft.show(star_count=3000, star_seed=int(rng.integers(2**31)))
    return replace(shown, sun_zenith_rad=float(rng.uniform(2.5, np.pi)))


def _city(draft: _Draft, rng: np.random.Generator) -> _Draft:
    return _night(draft, rng).show(city_dn=float(rng.uniform(150.0, 400.0)))


def _airglow(draft: _Draft, rng: np.random.Generator) -> _Draft:
    return _night(draft, rng).show(
        airglow_dn=float(rng.uniform(20.0, 80.0)),
        night_light=float(rng.choice([0.0, 0.5])),
        city_dn=float(rng.choice([0.0, 200.0])),
    )


def _moonlit(draft: _Draft, rng: np.random.Generator) -> _Draft:
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


def _hot_pixels(draft: _Draft, rng: np.random.Generator) -> _Draft:
    return draft.record(hot_pixels=int(rng.integers(100, 3000)))


def _vignetting(draft: _Draft, rng: np.random.Generator) -> _Draft:
    return draft.record(vignetting=float(rng.uniform(0.5, 0.9)))


def _jpeg(draft: _Draft, rng: np.random.Generator) -> _Draft:
    return draft.record(jpeg_quality=int(rng.integers(25, 80)))


def _banding(draft: _Draft, rng: np.random.Generator) -> _Draft:
    return draft.record(
        banding=float(rng.uniform(0.1, 0.4)), banding_period_px=float(rng.uniform(15.0, 200.0))
    )


def _daylight(draft: _Draft, rng: np.random.Generator) -> _Draft:
    """Air that scatters sunlight by its angle, which changes along every limb."""
    shown = draft.show(
        air_dn=float(rng.uniform(60.0, 200.0)), air_rayleigh=float(rng.uniform(0.3, 0.8))
    )
    return replace(shown, sun_zenith_rad=float(rng.uniform(0.0, 1.2)))


def _soft_corners(draft: _Draft, rng: np.random.Generator) -> _Draft:
    """Clouds without air, and a lens that blurs more away from its axis, as most do."""
    return draft.show(air_dn=0.0).record(
        psf_sigma_px=float(rng.uniform(0.5, 0.7)), corner_psf_px=float(rng.uniform(0.7, 1.1))
    )


def _low_sun(draft: _Draft, rng: np.random.Generator) -> _Draft:
    """Air that the Sun, high above to below the horizon, lights as it does ground: unevenly."""
    shown = draft.show(air_dn=float(rng.uniform(60.0, 220.0)), air_light="sine")
    return replace(
        shown,
        altitude_m=float(rng.uniform(250e3, 1000e3)),
        sun_zenith_rad=float(np.arccos(rng.uniform(-0.3, 1.0))),
    )


def _haze(draft: _Draft, rng: np.random.Generator) -> _Draft:
    """Air as thick as the Earth's, which hides the ground at the limb: red light to hazy blue."""
    return replace(
        _daylight(draft, rng).show(
            air_dn=float(rng.uniform(40.0, 170.0)),
            air_depth=float(np.exp(rng.uniform(np.log(3.0), np.log(25.0)))),
            air_scale_height_m=float(rng.uniform(6500.0, 9000.0)),
        ),
        altitude_m=float(np.exp(rng.uniform(np.log(300e3), np.log(800e3)))),
    )


def _balloon_haze(draft: _Draft, rng: np.random.Generator) -> _Draft:
    """The same from a balloon, within that air."""
    return replace(_haze(draft, rng), altitude_m=float(rng.uniform(25e3, 40e3)))


KINDS: dict[str, Callable[[_Draft, np.random.Generator], _Draft]] = {
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
