"""Cameras that contradict each other, over many sets: who is believed when one of them is blind."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from horizon_fixes import error_deg
from limb_frames import as_frames, clouds, limb_views
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.doubts import Doubts
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.earth_camera import SimFrame, render_views
from horizon_sensor_ros.sim.earth_scene import Imaging
from horizon_sensor_ros.sim.poses import rot_from_axis

ALTITUDE_M = 500e3
VIEWS = limb_views(ALTITUDE_M, azimuths_rad=(0.0, 1.5, 3.4))
ZENITH = np.array([0.6, 0.64, 0.48])
TURN = Rotation.from_euler("xyz", (3.0, -4.0, 2.0), degrees=True).as_matrix()
# The last one is mounted five degrees otherwise than is told.
TOLD = [*VIEWS[:2], replace(VIEWS[2], rot_base_from_cam=TURN @ VIEWS[2].rot_base_from_cam)]


@lru_cache(maxsize=16)
def drawn(steps: int) -> tuple[SimFrame, ...]:
    """Frames of all cameras after so many turns by .1 deg."""
    rot = rot_from_axis(-ZENITH, 0.7) @ Rotation.from_rotvec((0.0, 0.002 * steps, 0.0)).as_matrix()
    position = ZENITH * (Planet().radius_m + ALTITUDE_M)
    rng = np.random.default_rng(steps)
    return tuple(render_views(VIEWS, rot, position, clouds(3), rng, imaging=Imaging(noise_dn=1.5)))


class Flight:
    """Sets of frames of some cameras, one sensor."""

    def __init__(self, *cameras: int, views: list[CameraView] = TOLD) -> None:
        self._cameras = cameras
        self._views = [views[i] for i in cameras]
        self._sensor = HorizonSensor()
        self._steps = 0

    def tell(self, views: list[CameraView]) -> None:
        """How the cameras are mounted from now on, by what is told."""
        self._views = [views[i] for i in self._cameras]

    def fly(self, *dazzled: int) -> str:
        """One more set: which cameras are used, "" for no fix, and "!" where it is wrong."""
        shown = drawn(self._steps)
        self._steps += 1
        frames = as_frames(self._views, [shown[i] for i in self._cameras])
        frames = [
            Frame(frame.view, np.full_like(frame.gray, 255)) if i in dazzled else frame
            for i, frame in zip(self._cameras, frames, strict=True)
        ]
        self.fix = self._sensor.process(frames)
        used = "".join(name[-1] for name in self.fix.cameras_used)
        wrong = self.fix.ok and error_deg(self.fix, shown[0].truth.nadir_base) > 1.0
        return used + "!" * wrong


def test_a_camera_that_was_outvoted_is_not_believed_when_the_others_are_dazzled() -> None:
    flight = Flight(0, 1, 2)
    assert [flight.fly() for _ in range(4)] == ["12"] * 4
    assert flight.fly(0, 1) == ""
    assert flight.fix.status is Status.CAMERAS_DISAGREE
    assert "camera_3 alone sees a limb, and contradicted other cameras" in flight.fix.reason
    assert [flight.fly() for _ in range(2)] == ["12"] * 2


def test_of_two_that_contradict_each_other_neither_is_believed_alone() -> None:
    flight = Flight(0, 2)
    for _ in range(5):
        assert flight.fly() == ""
        assert flight.fix.status is Status.CAMERAS_DISAGREE
    # Three sets' worth of doubt, of five contradictions.
    assert [flight.fly(0) for _ in range(5)] == ["", "", "", "3!", "3!"]


def test_a_track_ends_where_another_camera_comes_to_see_its_limb_elsewhere() -> None:
    """Nobody knows at first that the one which sees a limb is mounted otherwise than is told."""
    flight = Flight(0, 2)
    assert flight.fly(0) == "3!"
    assert flight.fly(0) == "3!"
    assert flight.fly() == ""
    assert flight.fix.status is Status.CAMERAS_DISAGREE


@pytest.mark.parametrize("dazzled", [0, 1])
def test_cameras_that_agree_are_believed_alone(dazzled: int) -> None:
    flight = Flight(0, 1)
    alone = "21"[dazzled]
    assert [flight.fly() for _ in range(4)] == ["12"] * 4
    assert [flight.fly(dazzled) for _ in range(3)] == [alone] * 3
    assert [flight.fly() for _ in range(2)] == ["12"] * 2


def test_cameras_that_contradicted_each_other_are_believed_once_they_agree_in_three_sets() -> None:
    """Two of a wrong focal length agree, by chance, on a wrong limb in one set of ten."""
    flight = Flight(0, 2)
    assert [flight.fly() for _ in range(4)] == [""] * 4
    flight.tell(VIEWS)
    for _ in range(2):
        assert flight.fly() == ""
        assert flight.fix.status is Status.CAMERAS_DISAGREE
        assert "contradicted each other before" in flight.fix.reason
    flight.tell(TOLD)
    assert flight.fly() == ""
    flight.tell(VIEWS)
    assert [flight.fly() for _ in range(4)] == ["", "", "13", "13"]


def test_a_contradiction_of_days_is_outlived_in_minutes() -> None:
    """What it came from may be gone: of ever so many sets six hundred count."""
    doubts, nothing = Doubts(), HorizonFit.none(Status.CAMERAS_DISAGREE, "", "ml")
    both = ("camera_1", "camera_2")
    apart = HorizonFix(nothing.status, "", nothing, (), (), contradicting=both)
    alone = HorizonFix(Status.OK, "", nothing, (), both[:1])
    for _ in range(10_000):
        doubts.against(apart, followed=False)
    told = [doubts.against(alone, followed=False) for _ in range(700)]
    assert told[0].endswith("not believed for another 598 sets, unless they agree")
    assert "" not in told[:598]
    assert not any(told[598:])
