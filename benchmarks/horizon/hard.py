"""Hard scenes of every kind, by our own renderer: what is fixed, what is refused, what is wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from horizon.errors import BEYOND_NEES, fit_errors, nadir_sigma_deg
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.sim.hard_kinds import ALL_KINDS
from horizon_sensor_ros.sim.hard_scenes import HardScene, hard_scenes
from tables import Options, Table, number, percentile, verdict

WRONG_DEG, WRONG_SIGMAS = 1.0, 3.0
FIXED_BAR = 0.98  # of the solvable
COLUMNS = (
    "kind",
    "solvable",
    "fixed",
    "no limb",
    "fixed, no limb",
    "between",
    "fixed, between",
    "median, deg",
    "max, deg",
    "over 3 sigma",
    "wrong",
)
_EXPECT = ("fix", "none", "either")
# Limits that the calibration tries; the sensor's own are among them.
SIGMAS_DEG = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.75, 1.0, 2.0)
RESIDUALS_PX = (0.3, 0.5, 0.8, 1.2, 2.0, 4.0)
_Limits = tuple[float, float]  # of nadir's sigma, deg, and of the residual, px


@dataclass(frozen=True)
class Fixed:
    """One fix: its error, that squared in sigmas, its own sigma in nadir's least certain direction
    and residual, and whether it was to be expected.
    """

    error_deg: float
    nees: float
    sigma_deg: float
    residual_px: float
    solvable: bool

    @property
    def beyond(self) -> bool:
        """Whether the error is beyond three sigma."""
        return self.nees > BEYOND_NEES

    @property
    def wrong(self) -> bool:
        """Whether it is large, and above three sigma even of nadir's least certain direction."""
        return self.error_deg > max(WRONG_DEG, WRONG_SIGMAS * self.sigma_deg)


@dataclass
class _Tally:
    scenes: dict[str, int] = field(default_factory=lambda: dict.fromkeys(_EXPECT, 0))
    fixed: dict[str, int] = field(default_factory=lambda: dict.fromkeys(_EXPECT, 0))
    lone: dict[str, int] = field(default_factory=lambda: dict.fromkeys(("solvable", "fixed"), 0))
    fixes: list[Fixed] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)
    by_airglow: list[Fixed] = field(default_factory=list)

    def row(self, kind: str) -> tuple[str, ...]:
        counts = [str(n) for what in _EXPECT for n in (self.scenes[what], self.fixed[what])]
        errors_deg = [fix.error_deg for fix in self.fixes]
        return (
            kind,
            *counts,
            number(percentile(errors_deg, 50), 4),
            number(percentile(errors_deg, 100), 4),
            str(sum(fix.beyond for fix in self.fixes)),
            f"{len(self.wrong)} MISSED" if self.wrong else "0",
        )


class _Sensors:
    """The sensor with its default judgement and with hardly any, told which planet it is."""

    def __init__(self) -> None:
        strict = HorizonConfig()
        loose = replace(
            strict,
            max_nadir_sigma_rad=float(np.radians(SIGMAS_DEG[-1])),
            max_residual_px=RESIDUALS_PX[-1],
        )
        self._configs = (strict, loose)
        self._made: dict[bool, tuple[HorizonSensor, HorizonSensor]] = {}

    def look(self, scene: HardScene) -> tuple[HorizonFix, HorizonFix]:
        """Fix by the default judgement, and by the other one where that refuses."""
        planet = scene.scene.planet
        flat = planet.flattening > 0.0
        if flat not in self._made:
            one, other = (HorizonSensor(replace(c, planet=planet)) for c in self._configs)
            self._made[flat] = (one, other)
        drawn = zip(scene.views, scene.frames, strict=True)
        frames = [Frame(view, frame.image) for view, frame in drawn]
        for sensor in self._made[flat]:
            sensor.reset()
        judged = self._made[flat][0].process(frames)
        return judged, judged if judged.ok else self._made[flat][1].process(frames)


def run(options: Options) -> list[Table]:
    """One row a kind, and all of them; what the judgement's limits cost and spare."""
    tallies = {kind: _Tally() for kind in ALL_KINDS}
    everything = _Tally()
    believed: list[Fixed] = []
    sensors = _Sensors()
    scenes = hard_scenes(options.hard_scenes, options.seed, options.kinds)
    for scene in tqdm(scenes, total=options.hard_scenes, desc="Hard scenes", unit="scene"):
        judged, any_fix = sensors.look(scene)
        if any_fix.ok:
            believed.append(_fixed(scene, any_fix))
        for tally in (tallies[scene.kind], everything):
            tally.scenes[scene.expect] += 1
            if scene.expect == "fix" and len(scene.limb_cameras) == 1:
                tally.lone["solvable"] += 1
                tally.lone["fixed"] += judged.ok
            if judged.ok:
                fix = _fixed(scene, judged)
                tally.fixed[scene.expect] += 1
                tally.fixes.append(fix)
                if judged.airglow_alone and scene.expect == "none":
                    tally.by_airglow.append(fix)
                if fix.wrong:
                    tally.wrong.append(scene.name)
    if options.out is not None:
        draw(options.out / "horizon_hard.png", believed, everything.scenes["fix"])
    return [
        _scenes_table(options.hard_scenes, tallies, everything),
        _calibration_table(believed, everything.scenes["fix"]),
    ]


def _fixed(scene: HardScene, fix: HorizonFix) -> Fixed:
    truth = scene.frames[0].truth
    errors = fit_errors(fix.fit, truth.nadir_base, truth.altitude_m)
    return Fixed(
        errors.nadir_deg,
        errors.nees,
        nadir_sigma_deg(fix.fit.cov_nadir_altitude[:3, :3]),
        fix.fit.rms_residual_px,
        scene.expect == "fix",
    )


def _scenes_table(count: int, tallies: dict[str, _Tally], everything: _Tally) -> Table:
    rows = [tally.row(kind) for kind, tally in tallies.items() if any(tally.scenes.values())]
    solvable = everything.scenes["fix"]
    missed = 1.0 - everything.fixed["fix"] / solvable if solvable else np.nan
    beyond, lone = sum(fix.beyond for fix in everything.fixes), everything.lone
    worst = percentile([fix.error_deg for fix in everything.fixes], 100)
    worst_by_airglow = percentile([fix.error_deg for fix in everything.by_airglow], 100)
    notes = (
        "Two perpendicular 640 x 480 cameras, both given to the sensor with its default settings; "
        "of the planet it is told the shape (wgs84: no position, so it fits a sphere). "
        "solvable: at least one camera shows 200 px of limb that is lit (a step of 12 gray levels "
        "and of four times the noise) and not hidden; no limb: neither shows 40 px; between: the "
        "rest. By the drawn scene's truth, not by its kind.",
        f"Of the {solvable} solvable, {number(100.0 * missed, 1)} % are refused: "
        f"{verdict(missed, 1.0 - FIXED_BAR)}; of the {everything.scenes['none']} without a limb, "
        f"{everything.fixed['none']} are fixed, {len(everything.by_airglow)} by the airglow above "
        f"the dark one, {number(worst_by_airglow, 2)} deg off at most. Of the solvable, "
        f"{lone['solvable']} show it to one camera alone, and {lone['fixed']} of those are fixed: "
        "a short arc in glowing air.",
        "median, max: error of geocentric nadir of all fixes. over 3 sigma: fixes whose squared "
        f"error in sigmas is above {number(BEYOND_NEES, 2)} (0.3 % by the normal law); here "
        f"{beyond} of {len(everything.fixes)}.",
        f"wrong: above {WRONG_DEG:g} deg and three sigma of nadir's least certain direction: "
        f"{', '.join(everything.wrong) or 'none'}. Largest error, deg: "
        f"{number(worst, 3)}, {verdict(worst, WRONG_DEG)}.",
    )
    return Table(f"Hard scenes ({count})", COLUMNS, (*rows, everything.row("all")), notes)


# ---------------------------------------------------------------------------- calibration


def sweeps() -> tuple[tuple[str, tuple[float, ...], float, Callable[[float], _Limits]], ...]:
    """Each limit of the judgement: name, values, the sensor's own, and the limits at a value."""
    usual = _usual()
    return (
        ("nadir sigma, deg", SIGMAS_DEG, usual[0], lambda value: (value, usual[1])),
        ("residual, px", RESIDUALS_PX, usual[1], lambda value: (usual[0], value)),
    )


def _usual() -> _Limits:
    config = HorizonConfig()
    return round(float(np.degrees(config.max_nadir_sigma_rad)), 6), config.max_residual_px


def accepted(fixes: Sequence[Fixed], limits: _Limits) -> list[Fixed]:
    """Those of the fixes that pass both limits."""
    sigma_deg, residual_px = limits
    return [f for f in fixes if f.sigma_deg <= sigma_deg and f.residual_px <= residual_px]


def shares(fixes: Sequence[Fixed], solvable: int, limits: _Limits) -> tuple[float, float]:
    """Share of the accepted that are beyond three sigma, and of the solvable that are refused."""
    passed = accepted(fixes, limits)
    wrong = np.mean([fix.beyond for fix in passed]) if passed else np.nan
    good = sum(fix.solvable for fix in passed)
    return float(wrong), 1.0 - good / solvable if solvable else np.nan


def _calibration_table(believed: Sequence[Fixed], solvable: int) -> Table:
    rows = []
    for name, values, own, limits in sweeps():
        for value in values:
            passed = accepted(believed, limits(value))
            wrong, refused = shares(believed, solvable, limits(value))
            rows.append(
                (
                    name,
                    f"{value:g}" + (" (default)" if np.isclose(value, own) else ""),
                    str(len(passed)),
                    number(100.0 * wrong, 1),
                    str(sum(fix.error_deg > WRONG_DEG for fix in passed)),
                    number(100.0 * refused, 1),
                )
            )
    notes = (
        "What either limit of the judgement costs and spares, the other one as it is by default, "
        "over the fixes of all the scenes above. wrong: beyond three sigma, % of the fixes; "
        "refused: of the solvable scenes, %.",
        "In a picture: horizon_hard.png.",
    )
    columns = ("limit of", "at", "fixes", "wrong, %", f"over {WRONG_DEG:g} deg", "refused, %")
    return Table("Calibration of the judgement", columns, tuple(rows), notes)


def draw(path: Path, believed: Sequence[Fixed], solvable: int) -> None:
    """Draw error over claimed sigma of every fix, and what each limit costs and spares."""
    import matplotlib as mpl  # noqa: PLC0415  only where a picture is wanted

    mpl.use("Agg")
    from matplotlib import pyplot  # noqa: PLC0415  after the backend is chosen

    figure, (scatter, trade) = pyplot.subplots(1, 2, figsize=(12, 5), layout="constrained")
    limit = _usual()[0]
    for good, mark, label in ((True, ".", "solvable"), (False, "x", "other")):
        some = [fix for fix in believed if fix.solvable is good]
        x, y = [fix.sigma_deg for fix in some], [fix.error_deg for fix in some]
        scatter.loglog(x, y, mark, markersize=4, label=f"{label} ({len(some)})")
    ends = np.array([1e-5, 3.0])
    scatter.loglog(ends, WRONG_SIGMAS * ends, "k--", linewidth=1, label="three sigma at most")
    scatter.axvline(limit, color="0.5", linewidth=1, label=f"limit, {limit:g} deg")
    scatter.set(xlabel="claimed sigma of nadir, deg", ylabel="error of nadir, deg")
    scatter.legend(fontsize="small")
    for name, values, own, limits in sweeps():
        wrong, refused = np.array([shares(believed, solvable, limits(v)) for v in values]).T
        (line,) = trade.plot(100.0 * refused, 100.0 * wrong, "o-", markersize=3, label=name)
        for value, x, y in zip(values, 100.0 * refused, 100.0 * wrong, strict=True):
            weight = "bold" if np.isclose(value, own) else "normal"
            trade.annotate(
                f"{value:g}", (x, y), xytext=(3, 3), textcoords="offset points",
                fontsize="small", color=line.get_color(), weight=weight,
            )  # fmt: skip
    trade.axhline(0.27, color="0.5", linewidth=1, label="normal law")
    trade.set(xlabel="solvable scenes refused, %", ylabel="fixes beyond three sigma, %")
    trade.set_ylim(0.0, max(3.0, 1.2 * trade.get_ylim()[1]))
    trade.legend(fontsize="small")
    figure.savefig(path, dpi=110)
    pyplot.close(figure)
