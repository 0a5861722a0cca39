"""A bag of the shared Earth scenes, its replay, and what the replay wrote."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.mathematics.attitude import quaternion_from_rotation
from horizon_sensor_ros.sim.poses import camera_from_fov, side_views

START_S = 1_700_000_000
CAMERAS = ("camera_1", "camera_2")
_TYPESTORE = get_typestore(Stores.ROS2_JAZZY)
_TYPES: Any = _TYPESTORE.types
_IMAGE, _CAMERA_INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
_POSE = "geometry_msgs/msg/PoseStamped"


@dataclass(frozen=True)
class Fix:
    """What a replay published for one scene; sigmas of nadir (its worst direction) and altitude."""

    nadir_base: np.ndarray
    altitude_m: float
    nadir_sigma_deg: float
    altitude_sigma_m: float


def read_scenes(directory: Path) -> list[dict[str, Any]]:
    """Return the listed truth of every scene."""
    scenes: list[dict[str, Any]] = json.loads((directory / "truth.json").read_text())
    return scenes


def write_scenes(path: Path, directory: Path, scenes: Sequence[dict[str, Any]]) -> None:
    """Write an mcap bag: scene i at START_S + i seconds, camera_info before each image.

    Before those of a scene whose place is listed, the craft's pose, as it truly is.
    """
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {
            (name, kind): writer.add_connection(f"/{name}/{topic}", kind, typestore=_TYPESTORE)
            for name in CAMERAS
            for topic, kind in (("camera_info", _CAMERA_INFO), ("image_raw", _IMAGE))
        }
        poses = writer.add_connection("/coarse_pose", _POSE, typestore=_TYPESTORE)
        for i, scene in enumerate(scenes):
            time = (START_S + i) * 1_000_000_000
            if scene.get("position_ecef_km") is not None:
                raw = _TYPESTORE.serialize_cdr(_pose(_header(START_S + i, "earth"), scene), _POSE)
                writer.write(poses, time, raw)
                time += 1_000_000
            for name in CAMERAS:
                picture = directory / f"{scene['name']}_{name[-1]}.png"
                gray = cv2.imread(str(picture), cv2.IMREAD_UNCHANGED)
                if gray is None:
                    raise FileNotFoundError(f"{picture} is not a picture")
                header = _header(START_S + i, f"{name}_optical")
                for kind, msg in (
                    (_CAMERA_INFO, _camera_info(header, scene)),
                    (_IMAGE, _image(header, gray)),
                ):
                    raw = _TYPESTORE.serialize_cdr(msg, kind)
                    writer.write(topics[name, kind], time, raw)
                    time += 1_000_000


def write_parameters(path: Path, cameras: Sequence[str] = CAMERAS, **others: str) -> None:
    """Write the scenes' extrinsics and level frame (z down, as paper C's) as a ROS file.

    others : more parameters, as they stand in the file.
    """
    # The extrinsics do not depend on the lens.
    views = {view.name: view for view in side_views(_ANY_CAMERA)}
    lines = ["/**:", "  ros__parameters:", f"    cameras: [{', '.join(cameras)}]"]
    for name in cameras:
        quaternion = quaternion_from_rotation(views[name].rot_base_from_cam)
        lines.append(f"    {name}.rotation: {[float(value) for value in quaternion]}")
    lines.append("    level_z: down")
    lines += [f"    {name}: {value}" for name, value in others.items()]
    path.write_text("\n".join(lines) + "\n")


def replay(bag: Path, out: Path, parameters: Path, *arguments: str) -> str:
    """Run `horizon_replay` in a process of its own; return what it said of its work."""
    done = subprocess.run(
        [
            *(sys.executable, "-m", "horizon_sensor_ros.tools.bags.replay", str(bag), str(out)),
            *("--params", str(parameters), *arguments),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise RuntimeError(f"horizon_replay failed ({done.returncode}): {done.stderr}")
    lines = [line.strip() for line in done.stderr.splitlines() if "msg/s" not in line]
    return "; ".join(line for line in lines if line)


def read_fixes(bag: Path) -> dict[int, Fix]:
    """Return the fixes of a replay by scene index."""
    nadirs: dict[int, np.ndarray] = {}
    attitudes: dict[int, tuple[float, np.ndarray]] = {}
    with Reader(bag) as reader:
        wanted = [c for c in reader.connections if c.topic in ("/local_vertical", "/attitude")]
        for connection, _, raw in reader.messages(wanted):
            msg: Any = _TYPESTORE.deserialize_cdr(raw, connection.msgtype)
            index = msg.header.stamp.sec - START_S
            if connection.topic == "/local_vertical":
                nadirs[index] = np.array([msg.vector.x, msg.vector.y, msg.vector.z])
            else:
                # z is down: the altitude is minus the position's.
                cov = np.array(msg.pose.covariance).reshape(6, 6)
                attitudes[index] = (-msg.pose.pose.position.z, cov)
    if set(nadirs) != set(attitudes):
        raise RuntimeError(f"{bag}: local_vertical and attitude are not of the same scenes")
    return {
        index: Fix(
            nadir,
            attitudes[index][0],
            float(np.degrees(np.sqrt(np.linalg.eigvalsh(attitudes[index][1][3:5, 3:5])[-1]))),
            float(np.sqrt(attitudes[index][1][2, 2])),
        )
        for index, nadir in nadirs.items()
    }


_ANY_CAMERA: Camera = camera_from_fov(640, 480, 1.0)


def _header(seconds: int, frame_id: str) -> Any:
    stamp = _TYPES["builtin_interfaces/msg/Time"](sec=seconds, nanosec=0)
    return _TYPES["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id)


def _image(header: Any, gray: np.ndarray) -> Any:
    if gray.dtype != np.uint8 or gray.ndim != 2:
        raise ValueError(f"the shared scenes are mono8, got {gray.dtype} {gray.shape}")
    return _TYPES[_IMAGE](
        header=header,
        height=gray.shape[0],
        width=gray.shape[1],
        encoding="mono8",
        is_bigendian=0,
        step=gray.shape[1],
        data=np.ascontiguousarray(gray).reshape(-1),
    )


def _pose(header: Any, scene: dict[str, Any]) -> Any:
    x, y, z = np.array(scene["position_ecef_km"]) * 1e3
    turn = map(float, quaternion_from_rotation(np.array(scene["world_from_body"])))
    return _TYPES[_POSE](
        header=header,
        pose=_TYPES["geometry_msgs/msg/Pose"](
            position=_TYPES["geometry_msgs/msg/Point"](x=float(x), y=float(y), z=float(z)),
            orientation=_TYPES["geometry_msgs/msg/Quaternion"](*turn),
        ),
    )


def _camera_info(header: Any, scene: dict[str, Any]) -> Any:
    fx, cx, cy = scene["fx"], scene["cx"], scene["cy"]
    return _TYPES[_CAMERA_INFO](
        header=header,
        height=scene["height"],
        width=scene["width"],
        distortion_model=scene["model"],
        d=np.array(scene["distortion"], dtype=np.float64),
        k=np.array([fx, 0.0, cx, 0.0, fx, cy, 0.0, 0.0, 1.0]),
        r=np.eye(3).ravel(),
        p=np.array([fx, 0.0, cx, 0.0, 0.0, fx, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
        binning_x=0,
        binning_y=0,
        roi=_TYPES["sensor_msgs/msg/RegionOfInterest"](
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        ),
    )
