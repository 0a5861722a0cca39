"""Random hard scenes of every kind for two perpendicular 640 x 480 cameras.

What is to be expected of a scene is computed from its truth: how much lit, unhidden limb each frame
shows, not which kind it is meant to be.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.earth_camera import SimFrame, render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging, unit_vector
from horizon_sensor_ros.sim.hard_kinds import ALL_KINDS, KINDS, SceneDraft, plain_draft
from horizon_sensor_ros.sim.poses import (
    ROT_BODY_FROM_FORWARD_CAMERA,
    ROT_BODY_FROM_RIGHT_CAMERA,
    random_direction,
    side_views,
)

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


def hard_scenes(n: int, seed: int = 0, kinds: tuple[str, ...] | None = None) -> Iterator[HardScene]:
    """Draw n scenes, the kinds in turn; scene i of a seed is the same whatever n is.

    kinds : of `hard_kinds.KINDS`, default all of these, or of its `ALL_KINDS`; ValueError for
    others.
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
    draft = ALL_KINDS[kind](plain_draft(rng), rng)
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


def _nadir_body(draft: SceneDraft, planet: Planet) -> np.ndarray:
    """Nadir in the body frame, so that the cameras look `aim_rad` above the limb where possible."""
    rho = planet.rho_from_altitude(draft.altitude_m)
    x, y = (np.cos(rho + aim) for aim in draft.aim_rad)
    # two perpendicular axes cannot both lie closer than 45 deg to nadir
    excess = np.hypot(x, y) / np.sin(np.radians(75.0))
    if excess > 1.0:
        x, y = x / excess, y / excess
    return np.array([x, y, np.sqrt(1.0 - x * x - y * y)])


def _place(
    rng: np.random.Generator, nadir_body: np.ndarray, altitude_m: float, planet: Planet
) -> tuple[np.ndarray, np.ndarray]:
    """Random place over the planet, and an attitude there with that nadir and any heading."""
    latitude = float(np.arcsin(rng.uniform(-1.0, 1.0)))
    position = planet.ecef_from_geodetic(latitude, float(rng.uniform(-np.pi, np.pi)), altitude_m)
    nadir = planet.nadir_ecef(position)
    return _frame(nadir, random_direction(rng)) @ _frame(nadir_body, np.eye(3)[0]).T, position


def _frame(z: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """Orthonormal columns with the last along z and the first as near to a direction as it goes."""
    x = towards - z * (towards @ z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _light(
    rng: np.random.Generator,
    draft: SceneDraft,
    rot_world_from_body: np.ndarray,
    position: np.ndarray,
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
