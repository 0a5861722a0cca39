"""Paper B's model figure: nadir error over the field of applicability, noise-free frames, 300 km.

Two cameras, axes perpendicular to each other and to the craft's upright long axis, half-aperture 28
deg, 640 x 480, 8 bits. Frames are drawn without noise at every attitude of a grid of yaw and pitch
at which both frames hold the horizon; the sensor finds the limb in them once, and each method fits
the limb points that the sensor accepted. Beside it each method's model error: its fit to exact limb
points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from horizon_sensor_ros.core.applicability.error_map import fit_error
from horizon_sensor_ros.core.applicability.visibility import (
    horizon_in_view,
    horizon_rays,
    rot_base_from_down,
)
from horizon_sensor_ros.core.fits import METHODS, fit_horizon
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.mathematics.attitude import angle_rad
from horizon_sensor_ros.sim.earth_camera import render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.tools.applicability.figure6 import paper_rig
from tables import Options, Text, verdict

PAPER_RMS_DEG = 0.038
BAR_DEG = 0.005
_STEP_DEG, _COARSE_STEP_DEG = 6.0, 30.0
# Below this length in either frame an arc's end points say little; such attitudes are shown apart.
LONG_ARC_PX = 100.0
NO_NOISE = Imaging(noise_dn=0.0)
# The optical frame looks down its z axis; world x is up at this place: ahead north, right east.
ROT_WORLD_FROM_DOWN = np.column_stack([(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)])


@dataclass(frozen=True)
class PaperB:
    """Nadir errors over the field, degrees: NaN where a method gave no fix.

    yaw_deg, pitch_deg (M,) : the field's attitudes. shortest_px (M,) : the shorter of the two
    frames' horizon. frames_deg, exact_deg : by method, (M,) each, from drawn frames and from exact
    limb points. cameras (M,) : number of cameras that the sensor used, 0 for no fix.
    """

    yaw_deg: np.ndarray
    pitch_deg: np.ndarray
    shortest_px: np.ndarray
    frames_deg: dict[str, np.ndarray]
    exact_deg: dict[str, np.ndarray]
    cameras: np.ndarray


def run(options: Options) -> list[Text]:
    """One table over the field of applicability; a coarse grid where few frames are asked for."""
    step_deg = _STEP_DEG if options.frames >= 100 else _COARSE_STEP_DEG
    result = measure(step_deg)
    default = HorizonConfig().method
    errors = result.frames_deg[default]
    lines = [
        table(result, default),
        f"Grid of {step_deg:g} deg. {default} (default), RMS over its "
        f"{int(np.isfinite(errors).sum())} fixes: {verdict(rms(errors), BAR_DEG)}",
    ]
    return [Text("Paper B: error over the field of applicability", "\n".join(lines))]


def measure(step_deg: float = _STEP_DEG, methods: Sequence[str] = tuple(METHODS)) -> PaperB:
    """Draw, detect and fit over the field; about a second an attitude."""
    rig = paper_rig()
    altitude_m = 300e3
    degrees = np.arange(-90.0, 90.0 + step_deg / 2, step_deg)
    yaw, pitch = (grid.ravel() for grid in np.meshgrid(degrees, degrees))
    attitudes = rot_base_from_down(0.0, np.radians(pitch), np.radians(yaw), rig.nadir_at_zero)
    rays = horizon_rays(rig.planet, altitude_m)
    arcs = np.stack([horizon_in_view(view, rays, attitudes).arc_px for view in rig.views])
    field = np.flatnonzero(arcs.min(axis=0) > 0)
    dense = horizon_rays(rig.planet, altitude_m, 7200)
    position = np.array([rig.planet.radius_m + altitude_m, 0.0, 0.0])
    scene = EarthScene(planet=rig.planet)
    sensor = HorizonSensor(HorizonConfig(planet=rig.planet))

    frames_deg = {method: np.full(field.size, np.nan) for method in methods}
    exact_deg = {method: np.full(field.size, np.nan) for method in methods}
    cameras = np.zeros(field.size, dtype=int)
    for i, attitude in enumerate(tqdm(attitudes[field], desc="paper B", unit="attitude")):
        drawn = render_views(
            rig.views,
            ROT_WORLD_FROM_DOWN @ attitude.T,
            position,
            scene,
            np.random.default_rng(0),
            imaging=NO_NOISE,
        )
        sensor.reset()  # the attitudes are no sequence in time
        fix = sensor.process(
            [Frame(view, frame.image) for view, frame in zip(rig.views, drawn, strict=True)]
        )
        observations = [
            LimbObservation(view, limb)
            for view, limb in zip(rig.views, fix.limbs, strict=True)
            if view.name in fix.cameras_used
        ]
        cameras[i] = len(observations)
        nadir_true = attitude[:, 2]
        for method in methods:
            if fix.ok:
                fit = fit_horizon(observations, rig.planet, method)
                if fit.ok:
                    frames_deg[method][i] = np.degrees(angle_rad(fit.nadir_base, nadir_true))
            error = fit_error(rig.views, dense, attitude, rig.planet, method)
            exact_deg[method][i] = np.degrees(error)
    return PaperB(
        yaw_deg=yaw[field],
        pitch_deg=pitch[field],
        shortest_px=arcs.min(axis=0)[field],
        frames_deg=frames_deg,
        exact_deg=exact_deg,
        cameras=cameras,
    )


def rms(errors: np.ndarray) -> float:
    """Root mean square of those that are known; NaN for none."""
    known = errors[np.isfinite(errors)]
    return float(np.sqrt(np.mean(known**2))) if known.size else np.nan


def table(result: PaperB, default: str) -> str:
    """Lines of the table, the default method first."""
    total = result.yaw_deg.size
    long = result.shortest_px >= LONG_ARC_PX
    lines = [
        f"Paper B's layout, 300 km, noise-free frames: nadir error (deg) at {total} attitudes of "
        f"the field of applicability (paper: {PAPER_RMS_DEG} RMS)",
        f"{'':14} {'frames':^40} {f'arcs >= {LONG_ARC_PX:.0f} px':^16} {'exact points':^12}",
        f"{'method':14} {'RMS':>9} {'95 %':>9} {'max':>9} {'fixes':>10} "
        f"{'RMS':>9} {'of':>6} {'RMS':>12}",
    ]
    for method in sorted(result.frames_deg, key=lambda name: name != default):
        errors = result.frames_deg[method]
        known = errors[np.isfinite(errors)]
        p95, most = (np.percentile(known, 95), known.max()) if known.size else (np.nan, np.nan)
        exact = rms(result.exact_deg[method])
        name = f"{method} (default)" if method == default else method
        lines.append(
            f"{name:14} {rms(errors):9.5f} {p95:9.5f} {most:9.5f} {f'{known.size}/{total}':>10} "
            f"{rms(errors[long]):9.5f} {int(long.sum()):6d} "
            f"{'0' if exact < 1e-6 else f'{exact:.5f}':>12}"
        )
    two, one = (int(np.sum(result.cameras == number)) for number in (2, 1))
    lines.append(f"Fixes from both frames: {two}, from one: {one}, none: {total - two - one}.")
    return "\n".join(lines)
