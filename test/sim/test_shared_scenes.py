"""The limb drawn here against scenes drawn by an independent ray tracer at the same poses."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from limb_measurement import half_height_crossings, inside_frame, profiles, step_position

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.earth_camera import SimFrame, render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.poses import side_views

SCALE_HEIGHT_M = 9e3  # of the shared scenes' glow, as their README says
BACKGROUND_DN = 4.0


@pytest.fixture(scope="module")
def scenes(shared_data: Path) -> dict[str, dict[str, Any]]:
    listed = json.loads((shared_data / "earth_scenes" / "truth.json").read_text())
    return {scene["name"]: scene for scene in listed}


def draw(truth: dict[str, Any], scene: EarthScene) -> list[tuple[CameraView, SimFrame]]:
    camera = Camera(
        truth["width"],
        truth["height"],
        truth["fx"],
        truth["fx"],
        truth["cx"],
        truth["cy"],
        truth["model"],
        tuple(truth["distortion"]),
    )
    planet = Planet.wgs84() if truth["kind"] == "wgs84" else Planet()
    views = side_views(camera)
    frames = render_views(
        views,
        np.array(truth["world_from_body"]),
        np.array(truth["position_ecef_km"]) * 1e3,
        replace(scene, planet=planet),
        np.random.default_rng(0),
        imaging=Imaging(noise_dn=0.0, bits=16, background_dn=BACKGROUND_DN),
    )
    return list(zip(views, frames, strict=True))


def shared_image(shared_data: Path, name: str, view: CameraView) -> np.ndarray:
    path = shared_data / "earth_scenes" / f"{name}_{view.name[-1]}.png"
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    return image


def test_truth_is_the_same(scenes: dict[str, dict[str, Any]]) -> None:
    for listed in scenes.values():
        for _, frame in draw(listed, EarthScene()):
            truth = frame.truth
            np.testing.assert_allclose(truth.nadir_base, listed["nadir_body"], atol=1e-12)
            assert truth.altitude_m == pytest.approx(listed["altitude_km"] * 1e3, abs=10.0)
            if listed["geodetic_nadir_body"] is not None:
                np.testing.assert_allclose(
                    truth.geodetic_nadir_base, listed["geodetic_nadir_body"], atol=1e-9
                )


def test_uniform_planet_has_its_limb_at_the_same_place(
    scenes: dict[str, dict[str, Any]], shared_data: Path
) -> None:
    for view, frame in draw(scenes["flat0"], EarthScene(uniform_dn=191.2)):
        theirs = shared_image(shared_data, "flat0", view)
        limb = frame.truth.limb
        keep = inside_frame(limb.px, theirs.shape, 8.0)
        px, normal = limb.px[keep], limb.normal_px[keep]
        apart = half_height_crossings(theirs, px, normal) - half_height_crossings(
            frame.image, px, normal
        )
        assert len(apart) > 500
        assert abs(np.median(apart)) < 0.005
        assert np.percentile(np.abs(apart), 99) < 0.1
        # photometry too: apart from noise of 1 DN the images are one
        assert np.std(theirs - frame.image / 257.0) < 1.3


@pytest.mark.parametrize("name", ["clouds0", "earth0"])
def test_clouded_planet_has_its_limb_at_the_same_place(
    name: str, scenes: dict[str, dict[str, Any]], shared_data: Path
) -> None:
    seen = 0
    for view, frame in draw(scenes[name], EarthScene()):
        theirs = shared_image(shared_data, name, view)
        limb = frame.truth.limb
        keep = inside_frame(limb.px, theirs.shape, 8.0)
        if keep.sum() < 100:
            continue
        seen += 1
        px, normal = limb.px[keep], limb.normal_px[keep]
        # 0.757 px: their PSF of 0.7 px and the pixel's own width
        apart = step_position(theirs, px, normal, 0.757) - step_position(
            frame.image, px, normal, 0.757
        )
        assert abs(apart) < 0.1
    assert seen


@pytest.mark.parametrize("name", ["air0", "moon0", "boom0", "lens0", "wgs840", "high0"])
def test_glow_lies_at_the_same_height_above_the_limb(
    name: str, scenes: dict[str, dict[str, Any]], shared_data: Path
) -> None:
    """The glow falls by e every scale height: brightness ratios are shifts of the limb."""
    listed = scenes[name]
    for view, frame in draw(listed, EarthScene(uniform_dn=0.0, air_dn=255.0 * listed["air"])):
        theirs = shared_image(shared_data, name, view)
        limb = frame.truth.limb
        keep = inside_frame(limb.px, theirs.shape, 12.0)
        px, normal = limb.px[keep], limb.normal_px[keep]
        distance = np.linalg.norm(frame.truth.position_ecef_m)
        m_per_px = np.sqrt(distance**2 - 6371e3**2) / listed["fx"]
        at = np.arange(2.2, 4.4, 0.3)
        light_theirs, light_ours = (
            profiles(image, px, normal, at) - BACKGROUND_DN
            for image in (theirs, frame.image / 257.0)
        )
        shifts = []
        for part in np.array_split(np.arange(len(px)), 12):
            ratio = light_theirs[part].sum() / light_ours[part].sum()
            shifts.append(SCALE_HEIGHT_M / m_per_px * np.log(ratio))
        shifts = np.array(shifts)
        if name == "boom0" and view.name == "camera_1":  # the boom covers one part of twelve or two
            shifts = shifts[np.abs(shifts) < 1.0]
            assert len(shifts) >= 9
        assert abs(np.median(shifts)) < 0.05
        assert np.abs(shifts).max() < 0.2
