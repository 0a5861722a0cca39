"""Paper D's cases, and what its search costs."""

from __future__ import annotations

import numpy as np
from tqdm import tqdm

from horizon_sensor_ros.core.target_motion.registration import register
from horizon_sensor_ros.core.target_motion.section_patterns.candidate import candidate_of, motion
from horizon_sensor_ros.core.target_motion.section_patterns.direct_search import direct_search
from horizon_sensor_ros.core.target_motion.section_patterns.objective import (
    BatchObjective,
    objective,
    patterns_of,
)
from horizon_sensor_ros.core.target_motion.section_patterns.section_pattern import Sections, cut
from horizon_sensor_ros.core.target_motion.target_view import target_view
from horizon_sensor_ros.sim.paper_d import (
    CURRENT_DEG,
    PREVIOUS_DEG,
    SECTION_PITCH_M,
    paper_pose,
)
from horizon_sensor_ros.sim.tof_camera import ToFCamera
from tables import Options, Table, root_mean_square, verdict
from target.pairs import Pair, errors, scan_pair, timed

# Paper D's tables 1 and 2: errors of theta, phi, psi (deg) and x, y, z (cm).
PAPER = {
    ("n5", 1): ((0.17, -0.01, -0.14), (0.02, 0.27, 0.13)),
    ("n5", 2): ((0.38, -0.05, -0.33), (-0.05, 0.00, 0.23)),
    ("n1", 1): ((-1.29, 0.10, -0.59), (0.34, 0.38, -0.02)),
    ("n1", 2): ((1.17, 0.06, 0.45), (-0.36, -0.08, 0.01)),
}

# Its objective for variant 2 of N5, before the search, where that ends, and at the truth.
PAPER_VALUES = "0.17 0.85 0.87"

# Places so near in angle (rad) and shift (m) are compared for their plateau.
PLATEAU = np.array([np.radians(1.0)] * 3 + [0.01] * 3)


def search_sections(pair: Pair) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Method D: true candidate, the one found, and the one of the highest value alone."""
    sections = cut(pair.a.plain().astype(float), SECTION_PITCH_M)
    function = BatchObjective(sections, pair.b.plain())
    found = direct_search(function, np.array([np.radians(15.0)] * 3 + [0.08] * 3), plateau=PLATEAU)
    return candidate_of(sections, pair.pose_b_from_a), found.best, found.top


def paper_table(options: Options) -> Table:
    """Paper D's cases: the paper, method D here, the default here."""
    rows = []
    trials = max(3, min(options.frames // 10, 30))
    for (target, variant), (paper_deg, paper_cm) in PAPER.items():
        for noise in (0.0, 0.005):
            camera = ToFCamera(range_noise_m=noise)
            current = paper_pose(*CURRENT_DEG[variant])
            d_error: list[np.ndarray] = []
            top_error: list[np.ndarray] = []
            default = []
            drawn = range(trials if noise else 1)
            for trial in tqdm(drawn, desc=f"paper D, {target} {variant}", unit="pair"):
                rng = np.random.default_rng([options.seed, trial])
                pair = scan_pair(target, paper_pose(*PREVIOUS_DEG), current, rng, camera)
                if trial < 5:
                    truth, best, top = search_sections(pair)
                    d_error.append(best - truth)
                    top_error.append(top - truth)
                found = register(target_view(pair.a.points), target_view(pair.b.points))
                default.append(errors(found.pose_b_from_a, pair))
            found_d, top_d = (_angles_and_shift(np.array(e)) for e in (d_error, top_error))
            deg, cm = (root_mean_square(column) for column in np.array(default).T)
            paper = [round(f, 2) for f in (np.mean(np.abs(paper_deg)), np.linalg.norm(paper_cm))]
            # The paper's own strongest case is the bar of method D.
            barred = (target, variant) == ("n5", 2)
            rows.append((
                f"{target} variant {variant}, {1e3 * noise:g} mm",
                *(f"{e[0]:.2f} {e[1]:.2f}" for e in (paper, found_d, top_d)),
                "; ".join(map(verdict, found_d, paper)) if barred else "",
                f"{deg:.3f} {cm:.3f}",
                f"{verdict(deg, 0.06)}; {verdict(cm, 0.04)}" if noise else "",
            ))  # fmt: skip
    return Table(
        "Paper D's cases",
        (
            *("case", "paper", "method D", "D, highest value alone", "D: deg; cm"),
            *("default", "default: deg; cm"),
        ),
        tuple(rows),
        (
            "paper and D: mean absolute error of the angles (deg), length of the shift's (cm)",
            f"default: RMS of rotation (deg) and of the centroid's shift (cm), {trials} draws",
            "bar of method D: the paper's own figures",
        ),
    )


def _angles_and_shift(e: np.ndarray) -> tuple[float, float]:
    shift_cm = 100 * np.linalg.norm(e[:, 3:], axis=1).mean()
    return float(np.degrees(np.abs(e[:, :3])).mean()), float(shift_cm)


def literal_table(options: Options) -> Table:
    """Paper D's objective as printed and for many candidates at once; a whole search; the
    default.
    """
    rng = np.random.default_rng(options.seed)
    pair = scan_pair("n5", paper_pose(*PREVIOUS_DEG), paper_pose(*CURRENT_DEG[2]), rng, ToFCamera())
    sections = cut(pair.a.plain().astype(float), SECTION_PITCH_M)
    points = pair.b.plain().astype(float)
    batch = BatchObjective(sections, points)
    spread = np.array([0.1] * 3 + [0.03] * 3)
    candidates = candidate_of(sections, pair.pose_b_from_a) + rng.normal(size=(256, 6)) * spread
    batch(candidates)
    one = (
        min(
            timed(lambda: [objective(sections, points, c) for c in candidates[:64]])[1]
            for _ in range(3)
        )
        / 64
    )
    many = min(timed(lambda: batch(candidates))[1] for _ in range(5)) / len(candidates)
    search, seconds = timed(
        lambda: direct_search(batch, np.array([np.radians(15)] * 3 + [0.08] * 3), plateau=PLATEAU)
    )
    middle = min(
        timed(lambda: register(target_view(pair.a.points), target_view(pair.b.points)))[1]
        for _ in range(5)
    )
    literal = search.evaluations * one
    many_said = f"{one / many:.1f} x; {verdict(many / one, 0.1)}"
    default_said = f"{literal / middle:.0f} x; {verdict(middle / literal, 0.01)}"
    title = f"direct search, {search.evaluations} evaluations, "
    rows = (
        ("objective, one at a time", f"{1e6 * one:.0f} us", ""),
        ("objective, 256 at once", f"{1e6 * many:.0f} us", many_said),
        (title + "one at a time", f"{1e3 * literal:.0f} ms", "evaluations x time"),
        (title + "polls at once", f"{1e3 * seconds:.0f} ms", f"{literal / seconds:.1f} x"),
        ("default", f"{1e3 * middle:.1f} ms", default_said),
    )  # fmt: skip
    turn = errors(motion(sections, search.best), pair)
    truth = candidate_of(sections, pair.pose_b_from_a)
    values = [
        " ".join(
            f"{_value(sections, points, c, unit):.2f}" for c in (np.zeros(6), search.best, truth)
        )
        for unit in (1.0, SECTION_PITCH_M)
    ]
    return Table(
        "Paper D's cost (N5, variant 2)", ("what", "time", "faster"), rows,
        (
            f"the search ends {turn[0]:.2f} deg, {turn[1]:.2f} cm from the truth",
            f"objective before the search, where it ends, at the truth: {values[0]}; the same with "
            f"distances in metres, not in cells: {values[1]} (paper: {PAPER_VALUES})",
        ),
    )  # fmt: skip


def _value(sections: Sections, points: np.ndarray, candidate: np.ndarray, cell: float) -> float:
    """`objective` with the distance between neighbouring cells given: 1, or their pitch."""
    found = []
    patterns = patterns_of(sections, points, candidate)
    for pair in zip(sections.patterns, patterns, strict=True):
        for pattern, other in (pair, pair[::-1]):
            weight, filled = pattern.count * pattern.radius, pattern.count > 0
            near = np.pad(other.count > 0, 1)
            best = np.zeros(filled.shape)
            for i, j in np.ndindex(3, 3):
                there = near[i : i + filled.shape[0], j : j + filled.shape[1]]
                best = np.maximum(best, there * np.exp(-cell * np.hypot(i - 1, j - 1)))
            found.append((best * weight)[filled].sum() / weight[filled].sum())
    return float(np.mean(found))
