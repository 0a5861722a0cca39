"""Paper C's cases: the error table that its text has lost, and the steps of its iteration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.gauss_newton import solve_roll_pitch_rho
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.search.candidates import canny_candidates
from horizon_sensor_ros.core.mathematics.attitude import roll_pitch_from_nadir
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.earth_camera import render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.poses import camera_from_fov, pose_from_attitude
from tables import Options, Table, number

ROLL_DEG, PITCH_DEG, YAW_DEG = 20.0, 30.0, 0.0
STEPS_BAR = 5
COLUMNS = (
    "method",
    "roll, deg",
    "pitch, deg",
    "altitude, km",
    "altitude, %",
    "steps",
    "bar: steps",
)


@dataclass(frozen=True)
class Case:
    """One of the paper's drawings."""

    altitude_km: float
    fov_deg: float
    size_px: int

    @property
    def name(self) -> str:
        """As the table has it."""
        return f"{self.altitude_km:g} km, {self.fov_deg:g} deg, {self.size_px} x {self.size_px}"


CASES = (
    Case(3000.0, 60.0, 400),
    Case(6000.0, 40.0, 400),
    Case(6000.0, 40.0, 50),
    Case(6000.0, 80.0, 400),
    Case(6000.0, 80.0, 50),
)
RECORDINGS = {
    "ideal pinhole": Imaging(psf_sigma_px=0.0, noise_dn=0.0),
    "PSF 0.7 px, noise 2 DN": Imaging(),
}


@dataclass(frozen=True)
class _Drawing:
    """A case's frame; the base frame is the optical one, as in the paper."""

    case: Case
    frame: Frame

    def errors(self, nadir: np.ndarray, altitude_m: float) -> tuple[str, ...]:
        roll, pitch = roll_pitch_from_nadir(nadir, "down")
        off_km = altitude_m / 1e3 - self.case.altitude_km
        return (
            number(np.degrees(roll) - ROLL_DEG, 4),
            number(np.degrees(pitch) - PITCH_DEG, 4),
            number(off_km, 2),
            number(100.0 * off_km / self.case.altitude_km, 4),
        )


def draw(case: Case, imaging: Imaging, seed: int) -> _Drawing:
    """Draw a case: the camera's axis is the body's z, which points to the planet at zero roll and
    pitch.
    """
    camera = camera_from_fov(case.size_px, case.size_px, np.radians(case.fov_deg))
    view = CameraView("camera_1", camera, np.eye(3))
    rot_world_from_body, position = pose_from_attitude(
        case.altitude_km * 1e3, *np.radians([ROLL_DEG, PITCH_DEG, YAW_DEG])
    )
    frames = render_views(
        (view,),
        rot_world_from_body,
        position,
        EarthScene(),
        np.random.default_rng(seed),
        imaging=imaging,
    )
    return _Drawing(case, Frame(view, frames[0].image))


def papers_iteration(drawing: _Drawing) -> tuple[np.ndarray, bool]:
    """Return the states (K, 3) of roll, pitch and rho over all Canny edges of the frame, from zero
    in the camera's own frame, and whether they settled.
    """
    edges = canny_candidates(drawing.frame.gray)
    return solve_roll_pitch_rho(drawing.frame.view.camera.rays(edges.px))


def _steps(count: int, converged: bool) -> tuple[str, str]:
    ok = converged and count <= STEPS_BAR
    return str(count), f"{'met' if ok else 'MISSED'} ({STEPS_BAR})"


def _paper_row(drawing: _Drawing) -> tuple[str, ...]:
    states, converged = papers_iteration(drawing)
    roll, pitch, rho = states[-1]
    nadir = _nadir(roll, pitch)
    altitude = Planet().altitude_from_rho(_angle(rho))
    return (*drawing.errors(nadir, altitude), *_steps(len(states) - 1, converged))


def _sensor_row(drawing: _Drawing, config: HorizonConfig) -> tuple[str, ...]:
    fix = HorizonSensor(config).process([drawing.frame])
    if not fix.ok:
        return (fix.status.value, "-", "-", "-", "-", "")
    fit: HorizonFit = fix.fit
    steps = ("", "")
    if config.method == "gauss_newton":
        steps = _steps(len(fit.history) - 1, True)
    return (*drawing.errors(fit.nadir_base, fit.altitude_m), *steps)


def _nadir(roll: float, pitch: float) -> np.ndarray:
    return np.array([-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)])


def _angle(rho: float) -> float:
    """The same cosine's angle within 0 and pi."""
    return float(np.arccos(np.cos(rho)))


def _errors_table(recording: str, imaging: Imaging, seed: int) -> Table:
    rows = []
    for case in CASES:
        drawing = draw(case, imaging, seed)
        rows += [
            (f"{case.name}: as the paper", *_paper_row(drawing)),
            (
                f"{case.name}: gauss_newton, Canny",
                *_sensor_row(drawing, HorizonConfig(method="gauss_newton", limb="canny")),
            ),
            (f"{case.name}: default", *_sensor_row(drawing, HorizonConfig())),
        ]
    return Table(f"Paper C: errors, {recording}", COLUMNS, tuple(rows))


def _steps_table(seed: int) -> Table:
    drawing = draw(CASES[0], RECORDINGS["ideal pinhole"], seed)
    states, _ = papers_iteration(drawing)
    rows = []
    for k, (roll, pitch, rho) in enumerate(states):
        altitude = Planet().altitude_from_rho(_angle(rho))
        rows.append((str(k), *drawing.errors(_nadir(roll, pitch), altitude)))
    return Table(
        f"Paper C: errors step by step, {CASES[0].name}, ideal pinhole",
        ("step", *COLUMNS[1:5]),
        tuple(rows),
        (
            f"Roll {ROLL_DEG:g}, pitch {PITCH_DEG:g}, yaw {YAW_DEG:g} deg in every case (the paper "
            "says so of the first; of those at 6000 km it gives no attitude). The optical axis is "
            "the body's z. Uniform planet.",
            "as the paper: all Canny edges of the frame, Gauss-Newton from roll = pitch = altitude "
            "= 0 in the camera's frame. gauss_newton, Canny: the sensor with these settings, its "
            "iteration in a frame turned roughly towards the planet; default: the sensor as it "
            "comes.",
            "steps: until a step is below 1e-7 rad, that last one included.",
        ),
    )


def run(options: Options) -> list[Table]:
    """Return the error tables, and the first case step by step."""
    tables = [_errors_table(name, imaging, options.seed) for name, imaging in RECORDINGS.items()]
    return [*tables, _steps_table(options.seed)]
