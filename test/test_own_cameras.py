"""What doc/own_cameras.md says of a user's own cameras, its code run as it stands there."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import Vector3
from rosbags.typesys import Stores, get_typestore

from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.mathematics.attitude import nadir_from_roll_pitch
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.ros.messages.estimates import attitude_message

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "doc" / "own_cameras.md").read_text(encoding="utf-8")
STORE = get_typestore(Stores.ROS2_JAZZY)


def code_with(words: str) -> str:
    """The one block of Python on the page that has these words."""
    (code,) = (c for c in re.findall(r"```python\n(.*?)```", PAGE, re.S) if words in c)
    return code


def function(name: str) -> Any:
    known: dict[str, Any] = {"np": np}
    exec(code_with(f"def {name}("), known)
    return known[name]


def test_the_rotation_from_angles() -> None:
    def printed(left: float, down: float, roll: float) -> np.ndarray:
        code = code_with("left, down, roll").replace(
            "left, down, roll = 90.0, 25.0, 0.0", f"left, down, roll = {left}, {down}, {roll}"
        )
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            exec(code, {})
        return np.array([float(v) for v in out.getvalue().strip(" []\n").split()])

    example = yaml.safe_load((ROOT / "config" / "my_cameras.yaml").read_text())
    cameras = example["/**"]["ros__parameters"]
    for name, angles in (("camera_1", (0.0, 25.0, 0.0)), ("camera_2", (90.0, 25.0, 0.0))):
        told = np.array(cameras[name]["rotation"])
        assert abs(abs(told @ printed(*angles)) - 1) < 1e-6
        # The page's own file has the same two.
        assert str(cameras[name]["rotation"]) in PAGE
    from scipy.spatial.transform import Rotation

    up_in_the_picture = Rotation.from_quat(printed(0.0, 0.0, 10.0)).apply([0.0, -1.0, 0.0])
    assert up_in_the_picture[1] < -0.1, "its top towards its right"


@pytest.mark.parametrize("level_z", ["up", "down"])
def test_roll_and_pitch_out_of_the_messages(level_z: str) -> None:
    roll, pitch = 0.3, -0.7
    nadir = nadir_from_roll_pitch(roll, pitch, level_z)
    # What roll, pitch and altitude change by, by small errors of nadir and altitude.
    draws = np.random.default_rng(3).normal(size=(4000, 3)) * [2e-5, 4e-5, 300.0]
    across = np.cross(nadir, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    along = np.cross(nadir, across)
    spread = np.zeros((4, 4))
    spread[:3, :3] = 4e-10 * np.outer(across, across) + 16e-10 * np.outer(along, along)
    spread[3, 3] = 9e4
    from_attitude = function("from_attitude")

    def told(n: np.ndarray, altitude_m: float) -> Any:
        n = n / np.linalg.norm(n)
        fit = HorizonFit(Status.OK, "", "ml", n, 1.1, altitude_m, spread, 0.1, 9, 9, ("camera_1",))
        return from_attitude(attitude_message(fit, 0, level_z))

    values, sigmas = told(nadir, 5e5)
    np.testing.assert_allclose(values, (np.degrees(roll), np.degrees(pitch), 5e5), rtol=1e-9)
    found = [told(nadir + a * across + b * along, 5e5 + c)[0] for a, b, c in draws]
    np.testing.assert_allclose(np.std(found, axis=0), sigmas, rtol=0.05)
    if level_z == "up":
        v = Vector3(x=nadir[0], y=nadir[1], z=nadir[2])
        np.testing.assert_allclose(function("from_nadir")(v), (roll, pitch), atol=1e-12)
