"""Random pairs of targets, solved by the default and by everybody else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from tqdm import tqdm

from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.config import RegistrationConfig
from horizon_sensor_ros.core.target_motion.registration import Registration, register
from horizon_sensor_ros.core.target_motion.target_view import target_view
from horizon_sensor_ros.sim.tof_camera import ToFCamera, ToFDisturbances
from tables import Options, Table, number, percentile, verdict
from target.pairs import Pair, errors, nees, prior_near, random_pair, timed
from target.peers import PEERS, centroid_start

WRONG_DEG, WRONG_CM = 1.0, 2.0
COLD, TRACKED = "default, cold", "default, prior"


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
        # Half as many again of the target with the tightest bars.
        self.count = options.frames * 3 // 2 if title == "n5" else options.frames
        self.seed = options.seed
        self.methods: dict[str, Measured] = {}
        self.nees: list[float] = []
        self.reasons: dict[str, int] = {}
        self.refused_right = 0

    def measure(self) -> None:
        """Solve all pairs."""
        camera = ToFCamera()
        for k in tqdm(range(self.count), desc=self.title, unit="pair"):
            rng = np.random.default_rng([self.seed, k, len(self.title)])
            pair = random_pair(self.target, rng, camera, self.disturbances)
            self._default(pair, COLD, None)
            self._default(pair, TRACKED, prior_near(pair, rng))
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
                min_score=0.0, min_overlap=0.0, max_rotation_sigma_rad=1e9, max_shift_sigma_m=1e9
            )
            loose = register(target_view(pair.a.points), target_view(pair.b.points), bare)
            if loose.status is Status.OK:
                deg, cm = errors(loose.pose_b_from_a, pair)
                self.refused_right += deg < WRONG_DEG and cm < WRONG_CM


def pairs_table(sets: Sequence[RandomSet]) -> Table:
    """Errors and success of every method on every set."""
    rows = []
    for each in sets:
        for name, m in each.methods.items():
            rows.append((
                each.title, str(each.count), name, f"{100 * m.success:.1f} %",
                f"{m.refused}", f"{(~m.right).sum()}",
                f"{number(percentile(m.deg, 50), 3)} / {number(percentile(m.deg, 95), 3)}",
                f"{number(percentile(m.cm, 50), 3)} / {number(percentile(m.cm, 95), 3)}",
            ))  # fmt: skip
    return Table(
        "Random pairs",
        (
            "set",
            "pairs",
            "method",
            "success",
            "refused",
            "wrong",
            "deg, median / p95",
            "cm, median / p95",
        ),
        tuple(rows),
        (
            "0.5-30 deg, 0-20 cm, 5 mm; success: within 1 deg, 2 cm",
            "disturbed: 10 % outliers and 10 % occluded, hidden: 10 % occluded; refused ones"
            " count as no success",
            "errors are those of all answers, wrong ones included",
        ),
    )


def honesty_table(sets: Sequence[RandomSet]) -> Table:
    """NEES of the default's answers, and what it refused."""
    rows = []
    for each in sets:
        m = each.methods[COLD]
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
            bar = {TRACKED: 1.5, COLD: 2.5}.get(name)
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


def acceptance_table(sets: Sequence[RandomSet]) -> Table:
    """What is asked of the random pairs, and what came."""
    rows = []
    for each in sets:
        m, peers = each.methods[COLD], [each.methods[name] for name in PEERS]
        deg, cm = percentile(m.deg, 50), percentile(m.cm, 50)
        high = percentile(m.deg, 95)
        gicp = [percentile(each.methods[name].deg, 95) for name in PEERS if "small_gicp" in name]
        if each.title == "n5":
            rows.append(_row(each, "median, deg", deg, 0.04))
            rows.append(_row(each, "median, cm", cm, 0.03))
            rows.append(_row(each, "p95, deg", high, 0.12))
            rows.append(_row(each, "no success, %", 100 * (1 - m.success), 0.5))
        elif each.title == "n5 disturbed":
            rows.append(_row(each, "no success, %", 100 * (1 - m.success), 1.0))
            if gicp:
                rows.append(_row(each, "p95, deg, and half of small_gicp's", high, min(gicp) / 2))
        elif each.title == "n1":
            wrong = 100 * (~m.right).sum() / max(len(m.deg), 1)
            rows.append(_row(each, "wrong of those answered, %", wrong, 3.0))
        elif each.title == "body_of_revolution":
            weak = each.reasons.get(str(Status.ILL_CONDITIONED), 0)
            other = 100 * (1 - weak / each.count)
            rows.append(_row(each, "not refused as degenerate, %", other, 1.0))
        elif each.disturbances is None and peers:
            best = max(peer.success for peer in peers)
            rows.append(_row(each, "no success, %, and the best peer's", *_missed(m.success, best)))
            for name, mine, theirs in (
                ("deg", deg, [percentile(peer.deg, 50) for peer in peers]),
                ("cm", cm, [percentile(peer.cm, 50) for peer in peers]),
            ):
                rows.append(_row(each, f"median, {name}, and the best peer's", mine, min(theirs)))
    return Table(
        "Random pairs against what is asked",
        ("set", "what", "measured", "at most"),
        tuple(rows),
        ("success counts a refusal as none, but for n1, where it is neither right nor wrong",),
    )


def _missed(success: float, best: float) -> tuple[float, float]:
    return 100 * (1 - success), round(100 * (1 - best), 2)


def _row(each: RandomSet, what: str, value: float, bar: float) -> tuple[str, ...]:
    return each.title, what, number(value, 3), verdict(value, float(f"{bar:.4g}"))
