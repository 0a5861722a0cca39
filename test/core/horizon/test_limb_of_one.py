"""A limb that all cameras found, looked for again in one frame: what a search there would find."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from horizon_fixes import scenes_of
from limb_samples import nadir_nees
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.aiding import NOTHING_KNOWN
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.estimator import HorizonEstimator
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.judgement import nadir_sigma_rad
from horizon_sensor_ros.core.horizon.sighting import Sighting
from horizon_sensor_ros.core.horizon.single_cameras import SingleCameras
from horizon_sensor_ros.core.limb.detection import Detection
from horizon_sensor_ros.core.limb.detector import detect_limb, limb_of_one
from horizon_sensor_ros.core.mathematics.attitude import angle_rad
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.hard_scenes import HardScene

CONFIG = replace(HorizonConfig(), max_nadir_sigma_rad=np.pi)
ESTIMATOR = HorizonEstimator(CONFIG)
BOUNDS = {
    "rho_min_rad": ESTIMATOR.sphere.rho_from_altitude(CONFIG.altitude_max_m),
    "rho_max_rad": ESTIMATOR.sphere.rho_from_altitude(CONFIG.altitude_min_m),
}


def frames_of(scene: HardScene, turned_deg: float = 0.0) -> list[Frame]:
    """Frames of a scene, whose last camera is mounted otherwise than is said."""
    views = list(scene.views)
    turn = Rotation.from_rotvec(np.radians(turned_deg) * np.array([0.6, 0.64, 0.48])).as_matrix()
    views[-1] = replace(views[-1], rot_base_from_cam=turn @ views[-1].rot_base_from_cam)
    return [Frame(view, drawn.image) for view, drawn in zip(views, scene.frames, strict=True)]


def looked(frames: Sequence[Frame]) -> Detection:
    views, images = [frame.view for frame in frames], [frame.gray for frame in frames]
    return detect_limb(views, images, ESTIMATOR.sphere, **BOUNDS)


def sighting(frames: Sequence[Frame], detection: Detection) -> Sighting:
    return Sighting(frames, detection, ESTIMATOR.figure(NOTHING_KNOWN), NOTHING_KNOWN)


def sigmas_apart(frame: Frame, one: Detection, other: Detection) -> float:
    """Angle between the nadirs by two limbs in one frame, over the smaller of their sigmas."""
    fits = [ESTIMATOR.judged(sighting([frame], found)).fix.fit for found in (one, other)]
    apart_rad = angle_rad(*(fit.nadir_base for fit in fits))
    return float(apart_rad / min(map(nadir_sigma_rad, fits)))


@pytest.mark.parametrize(
    ("kind", "turned_deg"),
    [
        ("clouds", 0.3),
        ("air", 0.0),
        ("dim", 0.3),
        pytest.param("sun", 0.0, marks=pytest.mark.slow),
        pytest.param("clouds", 0.0, marks=pytest.mark.slow),
        pytest.param("air", 0.3, marks=pytest.mark.slow),
        pytest.param("dim", 0.0, marks=pytest.mark.slow),
        pytest.param("sun", 0.3, marks=pytest.mark.slow),
    ],
)
def test_it_is_where_a_search_of_the_frame_finds_it(kind: str, turned_deg: float) -> None:
    apart = []
    for scene in scenes_of(kind, 8):
        frames = frames_of(scene, turned_deg)
        together = looked(frames)
        for i, frame in enumerate(frames):
            one = limb_of_one(frame.view, frame.gray, ESTIMATOR.sphere, together, i, **BOUNDS)
            searched = looked([frame])
            if one is None or searched.limbs[0].status is not Status.OK:
                continue
            apart.append(sigmas_apart(frame, one, searched))
    # A search comes to the limb by another way, and may weigh its texture or air otherwise: by less
    # than the four sigma from which cameras contradict each other.
    assert len(apart) >= 10
    assert np.median(apart) < 0.4
    assert max(apart) < 3.0


def no_search(*_: object) -> Sighting:
    raise AssertionError("a whole frame was searched")


def test_no_camera_is_asked_about_a_layer_under_air_as_it_is_by_day() -> None:
    """One camera by itself took such air for a layer of airglow, and altitude claimed 100 km."""
    asked = 0
    for scene in scenes_of("air", 8):
        frames = frames_of(scene)
        seen = sighting(frames, looked(frames))
        fix = ESTIMATOR.judged(seen).fix
        if seen.detection.under_daylit_air and not seen.detection.consensus.unanimous:
            singles = SingleCameras(frames, no_search, no_search, ESTIMATOR, ESTIMATOR)
            assert singles.perhaps_of_layer(seen, fix) is None
            asked += 1
    assert asked >= 4


def test_a_layer_of_airglow_has_to_be_searched_for() -> None:
    layered = 0
    for scene in scenes_of("airglow", 6):
        frames = frames_of(scene)
        together = looked(frames)
        for i, frame in enumerate(frames):
            if looked([frame]).layer_rad > 0.0:
                one = limb_of_one(frame.view, frame.gray, ESTIMATOR.sphere, together, i, **BOUNDS)
                assert one is None
                layered += 1
    assert layered >= 4


@pytest.mark.parametrize("sigma_deg", [0.01, 0.3])
def test_a_spared_camera_that_by_itself_is_surer_has_the_fix(sigma_deg: float) -> None:
    """Its limb was measured around the cone of the other one: of a pair that others drew that was a
    degree off, at a quarter claimed. The spared camera by itself was 0.05 deg off.
    """
    for scene in scenes_of("clouds", 3):
        frames = frames_of(scene)
        seen = sighting(frames, looked(frames))
        right = ESTIMATOR.judged(seen).fix
        assert right.ok, right.reason
        off = Rotation.from_rotvec(np.radians([0.5, 0.0, 0.0])).apply(right.fit.nadir_base)
        cov = np.square(np.radians(sigma_deg)) * np.eye(4)
        wrong = replace(right.fit, nadir_base=off, cov_nadir_altitude=cov, cameras=("camera_1",))
        fix = replace(right, fit=wrong, cameras_used=("camera_1",))
        singles = SingleCameras(
            frames,
            lambda shown: sighting(shown, looked(shown)),
            lambda *_: None,
            ESTIMATOR,
            ESTIMATOR,
        )
        found = singles.by_own_limbs(seen, fix.surer_without_rest(seen.views))
        alone = singles.judged(1).fix
        assert alone.ok, alone.reason
        if nadir_sigma_rad(alone.fit) >= np.radians(sigma_deg):
            assert found is None
            continue
        assert found is not None
        assert found.cameras_used == ("camera_2",)
        assert found.cameras_spared == ("camera_1",)
        truth = scene.frames[0].truth.nadir_base
        assert nadir_nees(found.fit, truth) < 9.0
