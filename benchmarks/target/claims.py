"""Claims held against what errors are: NEES of pairs of random bodies, none of them twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import chi2
from tqdm import tqdm

from horizon_sensor_ros.core.mathematics.rigid import inverse_pose
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.registration import register
from horizon_sensor_ros.core.target_motion.target_view import target_view
from horizon_sensor_ros.sim.shapes import TriangleMesh, assembly, beam, box, cylinder
from horizon_sensor_ros.sim.tof_camera import ToFCamera
from tables import Options, Table, number
from target.pairs import BEYOND_NEES, nees, random_poses

_NOISE_M = (0.002, 0.005, 0.010)
# And of noise that grows as one over the cosine of the slant, where seen squarely.
_SLANT_NOISE_M = (0.005, 0.010)
# And of noise three times as large as pixels are wide at the target.
_FINE_NOISE_M, _FINE = 0.010, (640, 480)
_UNKNOWNS = 6


def random_body(rng: np.random.Generator) -> TriangleMesh:
    """Return a box or a tank, and on it one to four boxes, panels and booms anywhere."""
    main = box(rng.uniform(0.3, 1.2, 3))
    if rng.random() < 0.4:
        main = cylinder(rng.uniform(0.2, 0.6), rng.uniform(0.4, 1.4))
    parts = [main]
    for kind in rng.integers(3, size=rng.integers(1, 5)):
        place = rng.normal(0.0, 0.5, 3)
        if kind == 0:
            parts.append(box(rng.uniform(0.05, 0.6, 3), place))
        elif kind == 1:
            parts.append(box((rng.uniform(0.4, 1.2), rng.uniform(0.2, 0.6), 0.03), place))
        else:
            end = place * rng.uniform(1.5, 3.0) + rng.normal(0.0, 0.2, 3)
            parts.append(beam(place, end, rng.uniform(0.04, 0.15)))
    return assembly(parts)


def run(options: Options) -> list[Table]:
    """NEES by the noise of the ranges; a third of the pairs for each that is even, and as many for
    each that grows with the slant, and of narrower pixels.
    """
    count = max(options.frames // len(_NOISE_M), 1)
    rows = []
    every: list[float] = []
    cameras = _cameras()
    with tqdm(total=len(cameras) * count, desc="claims", unit="pair") as bar:
        for which, (name, camera) in enumerate(cameras.items()):
            found: list[float] = []
            for k in range(count):
                seed = [options.seed, k, round(1e6 * camera.range_noise_m)]
                found += _nees_of_a_pair(np.random.default_rng(seed), camera)
                bar.update()
            rows.append(_row(name, found, count))
            every += found if which < len(_NOISE_M) else []
    rows.insert(len(_NOISE_M), _row("all even", every, len(_NOISE_M) * count))
    middle, most = chi2.ppf((0.5, 0.9), _UNKNOWNS)
    return [
        Table(
            "Claims on random bodies",
            ("noise", "pairs", "let through", "NEES median", "p90", "beyond 3 sigma"),
            tuple(rows),
            (f"where the covariance is true: median {middle:.2f}, p90 {most:.1f}, 0.27 %",),
        )
    ]


def _cameras() -> dict[str, ToFCamera]:
    """Cameras by what is said of their noise, those of even noise first."""
    even = {f"{1e3 * each:.0f} mm": ToFCamera(range_noise_m=each) for each in _NOISE_M}
    slanted = {
        f"{1e3 * each:.0f} mm over cosine": ToFCamera(range_noise_m=each, slant_growth=1.0)
        for each in _SLANT_NOISE_M
    }
    usual, (width, height) = ToFCamera(), _FINE
    fine = replace(
        usual,
        width=width,
        height=height,
        pixel_pitch_m=usual.pixel_pitch_m * usual.width / width,
        range_noise_m=_FINE_NOISE_M,
    )
    return even | slanted | {f"{1e3 * _FINE_NOISE_M:.0f} mm, {width} x {height}": fine}


def _nees_of_a_pair(rng: np.random.Generator, camera: ToFCamera) -> list[float]:
    """Return one value of a pair that is let through, of others none."""
    body, poses = random_body(rng), random_poses(rng)
    found = register(*(target_view(camera.scan(body, pose, rng).points) for pose in poses))
    if found.status is not Status.OK:
        return []
    truth = poses[1] @ inverse_pose(poses[0])
    return [nees(found.pose_b_from_a, found.covariance, found.centre_m, truth)]


def _row(noise: str, found: list[float], pairs: int) -> tuple[str, ...]:
    if not found:
        return noise, str(pairs), "0", "-", "-", "-"
    middle, most = np.quantile(found, (0.5, 0.9))
    beyond = np.mean(np.array(found) > BEYOND_NEES)
    through, share = str(len(found)), f"{100 * beyond:.2f} %"
    return noise, str(pairs), through, number(middle, 2), number(most, 1), share
