"""The target: paper D's table, random pairs beside other registrations, honesty, time, long
sequences.

Also runs alone: `python benchmarks/target_bench.py --frames 300 --targets n5 n1`.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import cv2
import numpy as np
from tables import Options, Table, Text, number, percentile, root_mean_square, verdict
from target_pairs import MESHES, Pair, errors, nees, prior_near, random_pair, scan_pair, tumbling
from target_peers import MISSING, PEERS, centroid_start

from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target.direct_search import direct_search, plateau_mean
from horizon_sensor_ros.core.target.registration import (
    Registration,
    RegistrationConfig,
    register,
    target_view,
)
from horizon_sensor_ros.core.target.rigid import inverse_pose, pose_matrix, rotation_from_vector
from horizon_sensor_ros.core.target.section_pattern import (
    BatchObjective,
    candidate_of,
    cut,
    motion,
    objective,
)
from horizon_sensor_ros.core.target.tracker import TargetTracker
from horizon_sensor_ros.sim.tof_camera import ToFCamera, ToFDisturbances

PITCH_M = 0.026
WRONG_DEG, WRONG_CM = 1.0, 2.0
SOLVED = ("n5", "n1", "winged_cylinder", "plate_with_dish", "l_truss")
# Paper D's tables 1 and 2: errors of theta, phi, psi (deg) and x, y, z (cm).
PAPER = {
    ("n5", 1): ((0.17, -0.01, -0.14), (0.02, 0.27, 0.13)),
    ("n5", 2): ((0.38, -0.05, -0.33), (-0.05, 0.00, 0.23)),
    ("n1", 1): ((-1.29, 0.10, -0.59), (0.34, 0.38, -0.02)),
    ("n1", 2): ((1.17, 0.06, 0.45), (-0.36, -0.08, 0.01)),
}


def run(options: Options, targets: Sequence[str] = tuple(MESHES)) -> list[Table | Text]:
    """All tables of the target."""
    tables: list[Table | Text] = []
    if MISSING:
        tables.append(Text("Peers", f"not installed, left out: {', '.join(MISSING)}"))
    tables.append(paper_table(options))
    sets = [RandomSet(f"{name}", name, options) for name in targets]
    if "n5" in targets:
        sets.append(RandomSet("n5 disturbed", "n5", options, ToFDisturbances(0.1, 0.1)))
        sets.append(RandomSet("n5 mixed pixels", "n5", options, ToFDisturbances(mixed_pixels=True)))
    for each in sets:
        each.measure()
    tables += [pairs_table(sets), honesty_table(sets), time_table(sets), literal_table(options)]
    tables.append(profile_text(options))
    tables.append(sequence_table(options, [name for name in targets if name in SOLVED]))
    return tables


def paper_pose(pitch_roll_deg: float, yaw_deg: float) -> np.ndarray:
    """(4, 4) of the paper's attitude (pitch and roll alike), 5.5 m away."""
    a, b = np.radians([pitch_roll_deg, yaw_deg])
    turn = [rotation_from_vector(v) for v in ([0, a, 0], [a, 0, 0], [0, 0, b])]
    return pose_matrix(turn[0] @ turn[1] @ turn[2], np.array([0, 0, 5.5]))


def search_sections(pair: Pair) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Method D: true candidate, found by direct search, and the mean of its plateau."""
    sections = cut(pair.a.plain().astype(float), PITCH_M)
    function = BatchObjective(sections, pair.b.plain())
    found = direct_search(function, np.array([np.radians(15.0)] * 3 + [0.08] * 3))
    middle = plateau_mean(function, found.best, np.array([np.radians(1.0)] * 3 + [0.01] * 3))
    return candidate_of(sections, pair.pose_b_from_a), found.best, middle


def paper_table(options: Options) -> Table:
    """Paper D's cases: the paper, method D here, the default here."""
    rows = []
    trials = max(3, min(options.frames // 10, 30))
    for (target, variant), (paper_deg, paper_cm) in PAPER.items():
        for noise in (0.0, 0.005):
            camera = ToFCamera(range_noise_m=noise)
            current = paper_pose(24.5, 2) if variant == 1 else paper_pose(33.5, 11)
            d_error: list[np.ndarray] = []
            middle_error: list[np.ndarray] = []
            default = []
            for trial in range(trials if noise else 1):
                rng = np.random.default_rng([options.seed, trial])
                pair = scan_pair(target, paper_pose(23.5, 1), current, rng, camera)
                if trial < 5:
                    truth, best, middle = search_sections(pair)
                    d_error.append(best - truth)
                    middle_error.append(middle - truth)
                found = register(target_view(pair.a.points), target_view(pair.b.points))
                default.append(errors(found.pose_b_from_a, pair))
            cells = [_angles_and_shift(np.array(e)) for e in (d_error, middle_error)]
            deg, cm = (root_mean_square(column) for column in np.array(default).T)
            rows.append((
                f"{target} variant {variant}, {1e3 * noise:g} mm",
                f"{np.mean(np.abs(paper_deg)):.2f} {np.linalg.norm(paper_cm):.2f}",
                *cells, f"{deg:.3f} {cm:.3f}",
                verdict(deg, 0.06) if noise else "", verdict(cm, 0.04) if noise else "",
            ))  # fmt: skip
    return Table(
        "Paper D's cases",
        (
            "case",
            "paper",
            "method D",
            "D, plateau's mean",
            "default",
            "default, deg",
            "default, cm",
        ),
        tuple(rows),
        (
            "paper and D: mean absolute error of the angles (deg), length of the shift's (cm)",
            f"default: RMS of rotation (deg) and of the centroid's shift (cm), {trials} draws",
        ),
    )


def _angles_and_shift(e: np.ndarray) -> str:
    shift_cm = 100 * np.linalg.norm(e[:, 3:], axis=1).mean()
    return f"{np.degrees(np.abs(e[:, :3])).mean():.2f} {shift_cm:.2f}"


@dataclass
class Measured:
    """One method on one set: errors (deg, cm) of its answers, CPU time (s) of all."""

    deg: list[float] = field(default_factory=list)
    cm: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    refused: int = 0

    def add(self, pose: np.ndarray, pair: Pair, seconds: float) -> None:
        """Take an answer; one that is not finite is wrong by all there is."""
        deg, cm = errors(pose, pair) if np.isfinite(pose).all() else (180.0, 1e3)
        self.deg.append(deg)
        self.cm.append(cm)
        self.seconds.append(seconds)

    @property
    def right(self) -> np.ndarray:
        """Which answers are within the bars of success."""
        return (np.array(self.deg) < WRONG_DEG) & (np.array(self.cm) < WRONG_CM)

    @property
    def success(self) -> float:
        """Share of right ones of all pairs."""
        return float(self.right.sum() / max(len(self.deg) + self.refused, 1))


class RandomSet:
    """Random pairs of a target, solved by everything there is."""

    def __init__(
        self, title: str, target: str, options: Options, disturbances: ToFDisturbances | None = None
    ) -> None:
        self.title, self.target, self.disturbances = title, target, disturbances
        self.count, self.seed = options.frames, options.seed
        self.methods: dict[str, Measured] = {}
        self.nees: list[float] = []
        self.reasons: dict[str, int] = {}
        self.refused_right = 0

    def measure(self) -> None:
        """Solve all pairs."""
        camera = ToFCamera()
        for k in range(self.count):
            rng = np.random.default_rng([self.seed, k, len(self.title)])
            pair = random_pair(self.target, rng, camera, self.disturbances)
            self._default(pair, "default, cold", None)
            self._default(pair, "default, prior", prior_near(pair, rng))
            a, b = pair.a.plain().astype(float), pair.b.plain().astype(float)
            start = centroid_start(a, b)
            for name, peer in PEERS.items():
                pose, seconds = timed(partial(peer, a, b, start))
                self.methods.setdefault(name, Measured()).add(pose, pair, seconds)

    def _default(self, pair: Pair, name: str, prior: np.ndarray | None) -> None:
        def solve() -> Registration:
            a, b = target_view(pair.a.points), target_view(pair.b.points)
            return register(a, b, None, prior)

        measured = self.methods.setdefault(name, Measured())
        found, seconds = timed(solve)
        if found.status is Status.OK:
            measured.add(found.pose_b_from_a, pair, seconds)
            if prior is None:
                self.nees.append(
                    nees(found.pose_b_from_a, found.covariance, found.centre_m, pair.pose_b_from_a)
                )
            return
        measured.refused += 1
        measured.seconds.append(seconds)
        if prior is None:
            self.reasons[str(found.status)] = self.reasons.get(str(found.status), 0) + 1
            # What it would have said: the same with no bar to pass.
            bare = RegistrationConfig(
                min_score=0.0, min_overlap=0.0, max_rotation_std_rad=1e9, max_shift_std_m=1e9
            )
            loose = register(target_view(pair.a.points), target_view(pair.b.points), bare)
            if loose.status is Status.OK:
                deg, cm = errors(loose.pose_b_from_a, pair)
                self.refused_right += deg < WRONG_DEG and cm < WRONG_CM


def timed(function: Callable[[], object]) -> tuple:
    """Result and CPU seconds, which a busy machine changes least."""
    start = time.process_time()
    result = function()
    return result, time.process_time() - start


def pairs_table(sets: Sequence[RandomSet]) -> Table:
    """Errors and success of every method on every set."""
    rows = []
    for each in sets:
        for name, m in each.methods.items():
            rows.append((
                each.title, name, f"{100 * m.success:.1f} %", f"{m.refused}", f"{(~m.right).sum()}",
                f"{number(percentile(m.deg, 50), 3)} / {number(percentile(m.deg, 95), 3)}",
                f"{number(percentile(m.cm, 50), 3)} / {number(percentile(m.cm, 95), 3)}",
            ))  # fmt: skip
    return Table(
        "Random pairs",
        ("set", "method", "success", "refused", "wrong", "deg, median / p95", "cm, median / p95"),
        tuple(rows),
        (
            f"{sets[0].count} pairs each, 0.5-30 deg, 0-20 cm, 5 mm; success: within 1 deg, 2 cm",
            "disturbed: 10 % outliers and 10 % occluded; refused ones count as no success",
            "errors are those of all answers, wrong ones included",
        ),
    )


def honesty_table(sets: Sequence[RandomSet]) -> Table:
    """NEES of the default's answers, and what it refused."""
    rows = []
    for each in sets:
        m = each.methods["default, cold"]
        wrong = int((~m.right).sum())
        would = m.refused - each.refused_right + wrong
        middle = percentile(each.nees, 50)
        good = not each.nees or 3.5 <= middle <= 8
        rows.append((
            each.title, number(middle, 2), number(percentile(each.nees, 90), 1),
            "met" if good else "MISSED", str(would), str(wrong),
            "-" if not would else f"{100 * (1 - wrong / would):.1f} %",
            str(each.refused_right), ", ".join(f"{k} {v}" for k, v in each.reasons.items()) or "-",
        ))  # fmt: skip
    return Table(
        "Honesty of the default",
        ("set", "NEES median", "p90", "3.5 to 8", "wrong ones", "let through", "refused",
         "right but refused", "reasons"),
        tuple(rows),
        ("six degrees of freedom: median 5.35, p90 10.6 where the covariance is true",),
    )  # fmt: skip


def time_table(sets: Sequence[RandomSet]) -> Table:
    """CPU time a pair, and against VGICP."""
    rows = []
    for each in sets:
        rival = each.methods.get("small_gicp VGICP")
        base = percentile(rival.seconds, 50) if rival else np.nan
        for name, m in each.methods.items():
            middle = percentile(m.seconds, 50)
            bar = {"default, prior": 1.5, "default, cold": 2.5}.get(name)
            ratio = middle / base
            rows.append((
                each.title, name, number(1e3 * middle, 1),
                number(1e3 * percentile(m.seconds, 95), 1), number(ratio, 2),
                verdict(ratio, bar) if bar and rival else "",
            ))  # fmt: skip
    return Table(
        "Time of a pair, both clouds prepared from points",
        ("set", "method", "ms, median", "ms, p95", "of VGICP", ""),
        tuple(rows),
        ("CPU time of the process, one thread; prior: within 2 deg and 2 cm",),
    )


def literal_table(options: Options) -> Table:
    """Paper D's objective as printed and for many candidates at once; a whole search; the
    default."""
    rng = np.random.default_rng(options.seed)
    pair = scan_pair("n5", paper_pose(23.5, 1), paper_pose(33.5, 11), rng, ToFCamera())
    sections = cut(pair.a.plain().astype(float), PITCH_M)
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
        lambda: direct_search(batch, np.array([np.radians(15)] * 3 + [0.08] * 3))
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
    return Table(
        "Paper D's cost (N5, variant 2)", ("what", "time", "faster"), rows,
        (f"the search ends {turn[0]:.2f} deg, {turn[1]:.2f} cm from the truth",),
    )  # fmt: skip


def profile_text(options: Options) -> Text:
    """Where the default's time goes."""
    camera = ToFCamera()
    pairs = [random_pair("n5", np.random.default_rng([options.seed, k]), camera) for k in range(20)]
    profile = cProfile.Profile()
    profile.enable()
    for pair in pairs:
        register(target_view(pair.a.points), target_view(pair.b.points))
    profile.disable()
    lines = []
    wanted = (
        "range_image", "_plane_fit", "_borrow_planes", "_edges", "_edge_lines", "surface_view",
        "align_batch", "refine", "view_consistency", "uncertainty", "register",
    )  # fmt: skip
    for (file, _, name), (_, calls, _, total, _) in sorted(
        pstats.Stats(profile).stats.items(), key=lambda item: -item[1][3]
    ):
        if name in wanted and "target" in file and not (name == "_edges" and "refinement" in file):
            lines.append(
                f"{name:20s} {calls / len(pairs):5.1f} calls {1e3 * total / len(pairs):7.2f} ms"
            )
    return Text("Profile of a cold pair (N5, with the profiler's own cost)", "\n".join(lines))


def sequence_table(options: Options, targets: Sequence[str]) -> Table:
    """200 clouds at 5 Hz of tumbling targets: the tracker, and plain chaining beside it."""
    rows = []
    for target in targets:
        for rate in (3.0, 10.0):
            for seed in range(2 if options.frames >= 100 else 1):
                rows.append(_sequence(target, rate, options.seed + seed))
    return Table(
        "Sequences of 200 clouds at 5 Hz",
        ("target", "deg/s", "refused", "new frames", "keyframes", "end: deg, cm", "worst: deg, cm",
         "chained: deg, cm", "NEES pose, delta", "ms a cloud", "0.5 deg", "1 cm"),
        tuple(rows),
        ("errors since the target frame was set; chained: each cloud against the one before",),
    )  # fmt: skip


def _sequence(target: str, rate: float, seed: int) -> tuple[str, ...]:
    rng = np.random.default_rng([seed, int(rate)])
    poses = tumbling(rate, 200, 5.0, rng)
    camera, tracker = ToFCamera(), TargetTracker()
    found: list[tuple[float, float]] = []
    refused = frames = 0
    seconds, pose_nees, delta_nees = [], [], []
    frame = chained = before = previous = None
    for k, pose in enumerate(poses):
        cloud = camera.scan(MESHES[target], pose, rng).points
        fix, spent = timed(partial(tracker.process, cloud, k * 200_000_000))
        seconds.append(spent)
        if fix.status is not Status.OK:
            refused += 1
            continue
        frames += fix.new_frame
        view = target_view(cloud)
        if fix.new_frame:
            frame = inverse_pose(pose) @ fix.pose_sensor_from_target
            chained = fix.pose_sensor_from_target
        else:
            step = register(previous, view)
            chained = step.pose_b_from_a @ chained
        truth = pose @ frame
        pose_nees.append(_pose_nees(fix.pose_sensor_from_target, fix.covariance, truth))
        found.append(_pose_errors(fix.pose_sensor_from_target, truth))
        if fix.delta_previous_from_now is not None:
            delta_nees.append(
                _pose_nees(
                    fix.delta_previous_from_now, fix.delta_covariance, inverse_pose(before) @ truth
                )
            )
        before, previous = truth, view
    end, worst = found[-1], np.max(found, axis=0)
    loose = _pose_errors(chained, before)
    return (
        target, f"{rate:g}", str(refused), str(frames), str(fix.num_keyframes),
        f"{end[0]:.3f} {end[1]:.3f}", f"{worst[0]:.3f} {worst[1]:.3f}",
        f"{number(loose[0], 3)} {number(loose[1], 3)}",
        f"{np.median(pose_nees):.1f} {np.median(delta_nees):.1f}",
        f"{1e3 * np.median(seconds):.1f}", verdict(end[0], 0.5), verdict(end[1], 1.0),
    )  # fmt: skip


def _pose_errors(found: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    angle = np.arccos(np.clip((np.trace(found[:3, :3].T @ truth[:3, :3]) - 1) / 2, -1, 1))
    return float(np.degrees(angle)), float(100 * np.linalg.norm(found[:3, 3] - truth[:3, 3]))


def _pose_nees(found: np.ndarray, covariance: np.ndarray, truth: np.ndarray) -> float:
    return nees(found, covariance, found[:3, 3], truth)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=300, help="pairs a set")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--targets", nargs="+", choices=list(MESHES), default=list(MESHES))
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    for table in run(Options(arguments.frames, arguments.seed), arguments.targets):
        print(table.markdown(), flush=True)


if __name__ == "__main__":
    main()
