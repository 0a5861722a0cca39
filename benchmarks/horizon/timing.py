"""Time of a fix over that of cv2.Canny on the same frames, one thread: searched, and followed."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from horizon.errors import canny_seconds
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.detector import detect_limb
from horizon_sensor_ros.core.limb.passes import EXPECTED
from horizon_sensor_ros.core.limb.refinement import refine_limb
from horizon_sensor_ros.core.limb.sample import sample_limb
from horizon_sensor_ros.core.limb.search.candidates import space_boundary_candidates
from horizon_sensor_ros.core.limb.search.selection import limb_consensus, rays_of_candidates
from horizon_sensor_ros.core.limb_curve import limb_curve
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.planet_figure import Disc
from horizon_sensor_ros.sim.earth_camera import render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.flight import Flight
from horizon_sensor_ros.sim.poses import camera_from_fov, random_direction, rot_from_axis
from tables import Options, Table, number, verdict

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
    "search, ms",
    "search / Canny",
    "bar: search",
    "tracking, ms",
    "tracking / Canny",
    "bar: tracking",
    "fixed",
    "followed",
)
PAIR_COLUMNS = (
    "pair",
    "Canny, ms",
    "search, ms",
    "search / Canny",
    "tracking, ms",
    "tracking / Canny",
    "fixed",
    "followed",
    "limb and glow in one fit",
)
FOLLOWED_COLUMNS = ("frame", "limb drawn", "+ profiles", "+ edges", "all, ms")
# Bars, times Canny's, by width of the frame.
_BARS = {640: (6.0, 2.5), 2048: (4.0, 0.5)}
_TURN_RAD = np.radians(0.1)  # from frame to frame: about a pixel of the smaller frames
_STEPS = 3
_RATE_HZ = 30.0
_PAIR_STEPS = 6
# Brightness of the air at the limb, DN: below, above, and about that of the ground beside it.
_AIR_DN = (25.0, 130.0)


def limb_frames(width: int, height: int, texture: str, seed: int, index: int) -> list[Frame]:
    """Draw the limb across a frame from 300 to 1200 km, as the camera turns; the same scene for
    every size.
    """
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
    turn = _TURN_RAD * random_direction(rng)
    frames = []
    for step in range(_STEPS):
        turned = rot @ Rotation.from_rotvec(step * turn).as_matrix()
        drawn = render_views((view,), turned, position, scene, rng, imaging=Imaging())
        frames.append(Frame(view, drawn[0].image))
    return frames


def flown_pairs(glowing: bool, seed: int, index: int) -> list[list[Frame]]:
    """Draw what two cameras on a craft see as it flies over clouds, 300 to 800 km up."""
    rng = np.random.default_rng([seed, index, 0x72])
    start, node = rng.uniform(0.0, 2.0 * np.pi, 2)
    scene = EarthScene(
        texture="clouds",
        texture_seed=int(rng.integers(2**31)),
        air_dn=float(np.exp(rng.uniform(*np.log(_AIR_DN)))),
        air_scale_height_m=float(rng.uniform(6500.0, 9500.0)),
    )
    flight = Flight(
        altitude_m=float(rng.uniform(300e3, 800e3)),
        node_rad=float(node),
        start_rad=float(start),
        scene=scene if glowing else replace(scene, air_dn=0.0),
        seed=index,
    )
    drawn = (flight.frames(step / _RATE_HZ) for step in range(_PAIR_STEPS))
    views = flight.views
    return [
        [Frame(view, frame.image) for view, frame in zip(views, frames, strict=True)]
        for frames in drawn
    ]


def _stages(
    frames: list[Frame], searching: HorizonSensor, predicted: Disc
) -> dict[str, Callable[[], object]]:
    """What is timed, all of it on the last of the frames, in which a disc is predicted."""
    planet = Planet()
    frame, sensor = frames[-1], searching
    near = frame.view, predicted.nadir, predicted.rho_rad
    low = planet.rho_from_altitude(sensor.config.altitude_max_m)
    high = planet.rho_from_altitude(sensor.config.altitude_min_m)
    views, images = [frame.view], [frame.gray]
    looks = detect_limb(views, images, planet, rho_min_rad=low, rho_max_rad=high).looks[0]

    def find() -> object:
        found = [space_boundary_candidates(frame.gray)]
        return limb_consensus(rays_of_candidates(views, found), rho_min_rad=low, rho_max_rad=high)

    return {
        "canny": lambda: canny_seconds(images),
        "candidates": lambda: space_boundary_candidates(frame.gray),
        "consensus": find,
        "refinement": lambda: detect_limb(views, images, planet, rho_min_rad=low, rho_max_rad=high),
        "search": lambda: searching.process([frame]),
        "drawn": lambda: limb_curve(*near, spacing_px=max(1, round(frame.gray.shape[1] / 1024))),
        "profiles": lambda: sample_limb(frame.gray, *near, EXPECTED, modelled=True),
        "edges": lambda: refine_limb(frame.gray, *near, EXPECTED, looks),
        "tracking": _tracking([[each] for each in frames]),
    }


def _following(sets: Sequence[list[Frame]]) -> HorizonSensor:
    """Sensor that has seen all of the sets of frames but the last."""
    following = HorizonSensor()
    for frames in sets[:-1]:
        following.process(frames)
    return following


def _tracking(sets: Sequence[list[Frame]]) -> Callable[[], HorizonFix]:
    """Follow the limb to the last of the sets, `_REPEATS` times: each by a sensor of its own, to
    which the frames are new.
    """
    ready = [_following(sets) for _ in range(_REPEATS)]
    return lambda: ready.pop().process(sets[-1])


def _medians(stages: dict[str, Callable[[], object]]) -> dict[str, float]:
    """CPU seconds of each stage; they take turns, so that all see the same load."""
    taken: dict[str, list[float]] = {stage: [] for stage in stages}
    for _ in range(_REPEATS):
        for stage, call in stages.items():
            taken[stage].append(_seconds(call))
    return {stage: float(np.median(seconds)) for stage, seconds in taken.items()}


def _seconds(call: Callable[[], object]) -> float:
    start = time.process_time()
    call()
    return time.process_time() - start


def _row(
    name: str, width: int, times: dict[str, list[float]], fixed: str, followed: str
) -> tuple[str, ...]:
    canny = np.array(times["canny"])
    over = {
        stage: float(np.median(np.array(times[stage]) / canny)) for stage in ("search", "tracking")
    }
    search_bar, tracking_bar = _BARS[width]
    ms = {stage: number(1e3 * float(np.median(seconds)), 2) for stage, seconds in times.items()}
    return (
        name,
        *(ms[stage] for stage in ("canny", "candidates", "consensus", "refinement", "search")),
        number(over["search"], 1),
        verdict(over["search"], search_bar),
        ms["tracking"],
        number(over["tracking"], 1),
        verdict(over["tracking"], tracking_bar),
        fixed,
        followed,
    )


def _pairs(options: Options, searching: HorizonSensor) -> Table:
    """Time of a fix of two cameras, with the air above the limb and without."""
    count = min(_FRAMES, options.frames)
    rows = []
    for name, glowing in (("640 x 480, no air", False), ("640 x 480, glowing air", True)):
        times: dict[str, list[float]] = {"canny": [], "search": [], "tracking": []}
        fixed = followed = joint = 0
        for i in tqdm(range(count), desc=name, unit="pair"):
            pairs = flown_pairs(glowing, options.seed, i)
            last, images = pairs[-1], [frame.gray for frame in pairs[-1]]
            following = _following(pairs)
            fixed += searching.process(last).ok
            limbs = following.process(last).limbs
            followed += following.following
            joint += all(limb.glow_separated for limb in limbs)
            stages = {
                "canny": partial(canny_seconds, images),
                "search": partial(searching.process, last),
                "tracking": _tracking(pairs),
            }
            for stage, seconds in _medians(stages).items():
                times[stage].append(seconds)
        canny = np.array(times["canny"])
        cells = []
        for stage in ("search", "tracking"):
            seconds = np.array(times[stage])
            cells += [number(1e3 * np.median(seconds), 2), number(np.median(seconds / canny), 1)]
        counts = (f"{n}/{count}" for n in (fixed, followed, joint))
        rows.append((name, number(1e3 * float(np.median(canny)), 2), *cells, *counts))
    return Table(
        "Time of a fix of two cameras",
        PAIR_COLUMNS,
        tuple(rows),
        (
            "Two perpendicular cameras, 640 x 480, on simulated flights over clouds, 300 to 800 km "
            f"up, {_RATE_HZ:.0f} Hz; Canny: of both frames. Medians over {count} flights as above. "
            f"Followed: after {_PAIR_STEPS - 1} pairs. In one fit: followed pairs of which limb, "
            "glow and texture of both frames are fitted together; where the model of that does not "
            "hold the edges are placed one by one first, which takes longer.",
        ),
    )


def run(options: Options) -> list[Table]:
    """One row a size and planet."""
    count = min(_FRAMES, options.frames)
    searching = HorizonSensor(HorizonConfig(tracking=False))
    rows, followed_rows = [], []
    for width, height in SIZES_PX:
        for texture in ("uniform", "clouds"):
            name = f"{width} x {height}, {texture}"
            times: dict[str, list[float]] = {}
            fixed = followed = 0
            for i in tqdm(range(count), desc=name, unit="frame"):
                frames = limb_frames(width, height, texture, options.seed, i)
                following = _following([[frame] for frame in frames])
                fixed += searching.process(frames[-1:]).ok
                predicted = following.process(frames[-1:]).predicted
                followed += following.following
                if predicted is None:
                    continue  # doubtful where it was expected, and so searched for anew
                for stage, seconds in _medians(_stages(frames, searching, predicted)).items():
                    times.setdefault(stage, []).append(seconds)
            rows.append(_row(name, width, times, f"{fixed}/{count}", f"{followed}/{count}"))
            stages_ms = (
                number(1e3 * float(np.median(times[stage])), 2)
                for stage in ("drawn", "profiles", "edges", "tracking")
            )
            followed_rows.append((name, *stages_ms))
    return [
        Table(
            "Time of a fix",
            COLUMNS,
            tuple(rows),
            (
                "One camera, one thread. Medians over the frames of the median of "
                f"{_REPEATS} runs each, every run beside one of cv2.Canny (50, 150) on the same "
                "frame. candidates, + consensus, + refinement: time of a search up to there, ms; "
                "search: image to fix, fit and judgement included. tracking: the same frame, of a "
                "camera that turns by 0.1 deg a frame, after two others. / Canny: median of the "
                "frames' ratios, of frames that can be followed. CPU time.",
                "300 to 1200 km, field of view 60 deg across, noise 2 DN; every size sees the same "
                "scenes.",
            ),
        ),
        Table(
            "A followed frame, stage by stage",
            FOLLOWED_COLUMNS,
            tuple(followed_rows),
            (
                "Each stage with those before it, ms, as above. limb drawn: where it is predicted. "
                "+ profiles: sampled across it. + edges: kriged where the limb lies within a tenth "
                "of a pixel of the prediction, twice up to a third of a pixel off, else placed one "
                "by one first. all: with fit, judgement and covariance.",
            ),
        ),
        _pairs(options, searching),
    ]
