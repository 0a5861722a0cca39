"""Self-calibration of two perpendicular cameras from simulated bags, against the truth.

The frames are of cameras mounted as the truth says; the parameters are wrong by a misalignment.
"""

from __future__ import annotations

import multiprocessing
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin
from sensor_msgs.msg import CameraInfo, Image

from horizon_sensor_ros.core.mathematics.attitude import quaternion_from_rotation
from horizon_sensor_ros.core.mathematics.rigid import rotation_from_vector
from horizon_sensor_ros.core.seconds import ns_from_s
from horizon_sensor_ros.core.self_calibration.adjustment import calibrate
from horizon_sensor_ros.core.self_calibration.result import Calibration, CalibrationConfig
from horizon_sensor_ros.ros.messages.sensors import camera_info_message, encoded_image
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.flight import Flight, Swing
from horizon_sensor_ros.sim.poses import random_direction
from horizon_sensor_ros.tools.bags.output_bag import OutputBag
from horizon_sensor_ros.tools.calibration.recording import read_recording
from horizon_sensor_ros.tools.calibration.self_calibration import parsed
from tables import Options, Table, number, verdict

_MISALIGNMENT_DEG = 0.3
_BAR_DEG = 0.005
_SPACING_S = 20.0
_START_NS = 1_700_000_000_000_000_000
_CAMERA = "camera_2"
_WORKERS = 2


@dataclass(frozen=True)
class _Case:
    """A recording: what moves, what the planet looks like, and where camera_2 truly sits."""

    name: str
    truth_deg: np.ndarray
    flights: tuple[Flight, ...]  # one a frame set
    judged: bool = True


def run(options: Options) -> list[Table]:
    """Return one row a recording, and the sigmas' consistency over those that are judged."""
    sets = max(3 * options.frames // 4, 20)
    rows = []
    normalised: list[float] = []
    for case in _cases(sets, options.seed):
        with tempfile.TemporaryDirectory() as directory:
            found = _calibrated(case, Path(directory))
        rows.append(_row(case, found, normalised))
    nees = float(np.mean(normalised)) if normalised else np.nan
    columns = ("recording", "true misalignment", "error", "sigma", "largest error", "open", "cut")
    notes = (
        "640 x 480 pixels, 70 x 55 deg, clouds, 4 DN noise, one set in 20 s, altitude not known",
        f"misalignment of {_CAMERA}, deg about the base frame's x (forward), y, z (down); where "
        "something is open, along the two directions that are told",
        "open: what the command says it cannot tell of that camera; cut: frame sets without a say",
        f"squared error over variance, mean over {len(normalised)} values of the recordings with "
        f"a verdict: {number(nees, 2)} (1 is right, less is cautious)",
        "hazy: clouds of full contrast under glowing air; its sigma is to hold, not to be small",
    )
    title = f"Self-calibration, two perpendicular cameras, {sets} frame sets a recording"
    return [Table(title, columns, tuple(rows), notes)]


def _cases(sets: int, seed: int) -> list[_Case]:
    rng = np.random.default_rng([seed, 0xCA])
    mild, hard = {"cloud_contrast": 0.2}, {"air_dn": 60.0}
    drawn = random_direction(rng)
    truths = [("about x", np.eye(3)[0]), ("about y", np.eye(3)[1]), ("about z", np.eye(3)[2])]
    truths.append(("about a random axis", drawn))
    cases = [
        _Case(f"attitude swings, {name}", _MISALIGNMENT_DEG * axis, _swinging(sets, rng, mild))
        for name, axis in truths
    ]
    flight = replace(
        swinging_flight(rng, mild),
        roll=Swing(np.radians(7.0)),
        pitch=Swing(np.radians(-7.0)),
        yaw=Swing(),
    )
    climbing = tuple(
        replace(flight, altitude_m=altitude) for altitude in np.geomspace(400e3, 1200e3, sets)
    )
    truth = _MISALIGNMENT_DEG * drawn
    cases.append(_Case("altitude changes, attitude does not", truth, climbing))
    cases.append(_Case("attitude swings, hazy", truth, _swinging(sets, rng, hard), judged=False))
    return cases


def _swinging(sets: int, rng: np.random.Generator, scene: dict[str, float]) -> tuple[Flight, ...]:
    return (swinging_flight(rng, scene),) * sets


def swinging_flight(rng: np.random.Generator, scene: dict[str, float]) -> Flight:
    """Orbit at 400 to 800 km; roll and pitch swing by 15 deg about 12 deg, limb in the frames."""

    def swing(mean_deg: float) -> Swing:
        amplitude = np.radians(rng.uniform(14.0, 16.0))
        return Swing(np.radians(mean_deg), amplitude, rng.uniform(70.0, 130.0), rng.uniform(0, 6))

    return Flight(
        altitude_m=float(rng.uniform(400e3, 800e3)),
        node_rad=float(rng.uniform(0.0, 6.0)),
        start_rad=float(rng.uniform(0.0, 6.0)),
        roll=swing(12.0),
        pitch=swing(-12.0),
        scene=EarthScene(
            texture="clouds",
            texture_seed=int(rng.integers(1 << 30)),
            cloud_contrast=scene.get("cloud_contrast", 1.0),
            air_dn=scene.get("air_dn", 0.0),
        ),
        imaging=Imaging(noise_dn=4.0),
        seed=int(rng.integers(1 << 30)),
    )


def _images(flight: Flight, time_s: float) -> tuple[np.ndarray, ...]:
    return tuple(frame.image for frame in flight.frames(time_s))


def _calibrated(case: _Case, directory: Path) -> Calibration:
    """Write the bag and the wrong parameters; calibrate as the command does."""
    bag, params = directory / "bag", directory / "params.yaml"
    _write_bag(bag, case)
    views = case.flights[0].views
    lines = ["/**:", "  ros__parameters:", "    level_z: down"]
    for view in views:
        rot = view.rot_base_from_cam
        if view.name == _CAMERA:
            rot = rotation_from_vector(-np.radians(case.truth_deg)) @ rot
        lines.append(f"    {view.name}.rotation: {quaternion_from_rotation(rot).tolist()}")
    params.write_text("\n".join(lines) + "\n", encoding="utf-8")
    arguments = parsed([str(bag), "--params", str(params)])
    recording = read_recording(arguments, bool)
    return calibrate(
        recording.sets, recording.rot_base_from_cam, recording.sphere, CalibrationConfig()
    )


def _write_bag(path: Path, case: _Case) -> None:
    bag = OutputBag(path, StoragePlugin.MCAP)
    views = case.flights[0].views
    for view in views:
        bag.add_topic(f"/{view.name}/image_raw", Image)
        bag.add_topic(f"/{view.name}/camera_info", CameraInfo)
    spawn = multiprocessing.get_context("spawn")
    times = [_SPACING_S * i for i in range(len(case.flights))]
    with ProcessPoolExecutor(_WORKERS, mp_context=spawn) as pool:
        for time_s, images in zip(times, pool.map(_images, case.flights, times), strict=True):
            stamp = _START_NS + ns_from_s(time_s)
            for view, image in zip(views, images, strict=True):
                frame = f"{view.name}_optical"
                info = camera_info_message(view.camera, stamp, frame)
                bag.write(f"/{view.name}/camera_info", stamp, info)
                bag.write(f"/{view.name}/image_raw", stamp, encoded_image(image, stamp, frame))
    bag.finish()


def _row(case: _Case, found: Calibration, normalised: list[float]) -> tuple[str, ...]:
    """Cells of a recording; squared errors over variances of a judged one are added."""
    truth = _list(case.truth_deg, 3)
    if not found.ok:
        return case.name, truth, found.reason, "", "", "MISSED" if case.judged else "", ""
    where = found.unknowns.where("rotation", _CAMERA)
    error = np.degrees(found.values[where]) - case.truth_deg
    cov = np.rad2deg(np.rad2deg(found.cov[np.ix_(where, where)]))
    whole = all(found.observed(int(i)) == "yes" for i in where)
    directions = np.eye(3) if whole else _told(cov)
    along = directions @ error
    variance = np.einsum("ij,jk,ik->i", directions, cov, directions)
    if case.judged:
        normalised += (along**2 / variance).tolist()
    largest = float(np.abs(along).max())
    own = [s for s in found.not_observed if s.startswith(_CAMERA)]
    return (
        case.name,
        truth,
        _list(along, 4),
        _list(np.sqrt(variance), 4),
        verdict(largest, _BAR_DEG) if case.judged else "",
        "; ".join(own).partition(":")[0] or "nothing",
        str(int((~found.used).sum())),
    )


def _told(cov: np.ndarray) -> np.ndarray:
    """Directions (K, 3) that have a variance at all."""
    values, vectors = np.linalg.eigh(cov)
    return vectors.T[values > 1e-9 * values[-1]]


def _list(values: np.ndarray, digits: int) -> str:
    return ", ".join(number(float(value), digits) for value in values)
