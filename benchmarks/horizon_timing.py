"""Time of the search for the horizon over that of cv2.Canny on the same frames, one thread."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from horizon_errors import canny_seconds
from tables import Options, Table, number
from tqdm import tqdm

from horizon_sensor_ros.core.camera import CameraView
from horizon_sensor_ros.core.horizon_sensor import Frame, HorizonConfig, HorizonSensor
from horizon_sensor_ros.core.limb.candidates import space_boundary_candidates
from horizon_sensor_ros.core.limb.detector import detect_limb
from horizon_sensor_ros.core.limb.selection import limb_consensus, rays_of_candidates
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.earth_camera import render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.poses import camera_from_fov, random_direction, rot_from_axis

SIZES_PX = ((640, 480), (2048, 1536))
_FRAMES = 10
_REPEATS = 5
_FOV_RAD = np.radians(60.0)
COLUMNS = (
    "frame",
    "Canny, ms",
    "candidates",
    "+ consensus",
    "+ refinement",
    "all, ms",
    "all / Canny",
    "fixed",
)


def limb_frame(width: int, height: int, texture: str, seed: int, index: int) -> Frame:
    """Draw the limb across a frame from 300 to 1200 km; the same scene for every size."""
    rng = np.random.default_rng([seed, index, 0x71])
    altitude = float(np.exp(rng.uniform(np.log(300e3), np.log(1200e3))))
    planet = Planet()
    nadir = random_direction(rng)
    across = np.cross(nadir, random_direction(rng))
    across /= np.linalg.norm(across)
    off = planet.rho_from_altitude(altitude) + rng.uniform(-0.15, 0.15)
    rot = rot_from_axis(
        np.cos(off) * nadir + np.sin(off) * across, float(rng.uniform(0.0, 2.0 * np.pi))
    )
    scene = EarthScene(planet=planet, texture=texture, texture_seed=int(rng.integers(2**31)))
    view = CameraView("camera_1", camera_from_fov(width, height, _FOV_RAD), np.eye(3))
    position = -nadir * (planet.radius_m + altitude)
    drawn = render_views((view,), rot, position, scene, rng, imaging=Imaging())
    return Frame(view, drawn[0].image)


def _stages(frame: Frame, sensor: HorizonSensor) -> dict[str, Callable[[], object]]:
    planet = Planet()
    low = planet.rho_from_altitude(sensor.config.altitude_max_m)
    high = planet.rho_from_altitude(sensor.config.altitude_min_m)
    views, images = [frame.view], [frame.gray]

    def find() -> object:
        found = [space_boundary_candidates(frame.gray)]
        return limb_consensus(rays_of_candidates(views, found), rho_min_rad=low, rho_max_rad=high)

    return {
        "canny": lambda: canny_seconds(images),
        "candidates": lambda: space_boundary_candidates(frame.gray),
        "consensus": find,
        "refinement": lambda: detect_limb(views, images, planet, rho_min_rad=low, rho_max_rad=high),
        "all": lambda: sensor.process([frame]),
    }


def _seconds(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def run(options: Options) -> list[Table]:
    """One row a size and planet."""
    count = min(_FRAMES, options.frames)
    sensor = HorizonSensor(HorizonConfig())
    rows = []
    for width, height in SIZES_PX:
        for texture in ("uniform", "clouds"):
            name = f"{width} x {height}, {texture}"
            times: dict[str, list[float]] = {}
            fixed = 0
            for i in tqdm(range(count), desc=name, unit="frame"):
                frame = limb_frame(width, height, texture, options.seed, i)
                stages = _stages(frame, sensor)
                fixed += sensor.process([frame]).ok
                taken: dict[str, list[float]] = {stage: [] for stage in stages}
                for _ in range(_REPEATS):
                    for stage, call in stages.items():
                        taken[stage].append(_seconds(call))
                for stage, seconds in taken.items():
                    times.setdefault(stage, []).append(float(np.median(seconds)))
            canny = np.array(times["canny"])
            ratio = float(np.median(np.array(times["all"]) / canny))
            rows.append(
                (
                    name,
                    number(1e3 * float(np.median(canny)), 2),
                    *(
                        number(1e3 * float(np.median(times[stage])), 2)
                        for stage in ("candidates", "consensus", "refinement", "all")
                    ),
                    number(ratio, 1),
                    f"{fixed}/{count}",
                )
            )
    return [
        Table(
            "Time of the search",
            COLUMNS,
            tuple(rows),
            (
                "One camera, one thread, no tracking. Medians over the frames of the median of "
                f"{_REPEATS} runs each, every run beside one of cv2.Canny (50, 150) on the same "
                "frame. candidates, + consensus, + refinement: time up to there, ms; all: image to "
                "fit, fit and judgement included. all / Canny: median of the frames' ratios.",
                "300 to 1200 km, field of view 60 deg across, noise 2 DN; every size sees the same "
                "scenes.",
            ),
        )
    ]
