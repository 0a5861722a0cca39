"""Claims held against what errors are: NEES of pairs of random bodies, none of them twice."""

from __future__ import annotations

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
    each that grows with the slant.
    """
    count = max(options.frames // len(_NOISE_M), 1)
    rows = []
    every: list[float] = []
    kinds = [(noise_m, 0.0) for noise_m in _NOISE_M] + [
        (noise_m, 1.0) for noise_m in _SLANT_NOISE_M
    ]
    with tqdm(total=len(kinds) * count, desc="claims", unit="pair") as bar:
        for noise_m, growth in kinds:
            camera = ToFCamera(range_noise_m=noise_m, slant_growth=growth)
            found: list[float] = []
            for k in range(count):
                rng = np.random.default_rng([options.seed, k, round(1e6 * noise_m)])
                found += _nees_of_a_pair(rng, camera)
                bar.update()
            name = f"{1e3 * noise_m:.0f} mm" + (" over cosine" if growth else "")
            rows.append(_row(name, found, count))
            every += [] if growth else found
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
