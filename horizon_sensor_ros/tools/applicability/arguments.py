"""What the arguments that several modes share ask for."""

from __future__ import annotations

import argparse

import numpy as np

from horizon_sensor_ros.core.applicability.visibility import horizon_rays, rot_base_from_down
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.tools.applicability.figures import AngleGrid
from horizon_sensor_ros.tools.camera_file import CameraFileError, Rig

AXES = ("roll", "pitch", "yaw")
MOST_ATTITUDES = 2_000_000


def angle_grid(args: argparse.Namespace) -> AngleGrid:
    """Return the two angles of the map. ValueError names the option that is wrong."""
    if not 0 < args.step < np.inf:
        raise ValueError(f"--step must be positive, and finite, got {args.step:g}")
    both: list[tuple[float, float]] = []
    for option, limits in (("--range", args.range), ("--y-range", args.y_range or args.range)):
        low, high = limits
        if not (np.isfinite(low) and low < high <= low + 360):
            raise ValueError(f"{option} must rise by at most 360 degrees, got {low:g} {high:g}")
        both.append((low, (high - low) / args.step + 1e-9))
    # Asked before there are any: they would not fit into memory.
    attitudes = (both[0][1] + 1.0) * (both[1][1] + 1.0)
    if attitudes > MOST_ATTITUDES:
        raise ValueError(
            f"--step {args.step:g} makes {attitudes:.4g} attitudes, more than {MOST_ATTITUDES}; "
            "take a wider step or a narrower range"
        )
    angles = [low + args.step * np.arange(int(steps) + 1) for low, steps in both]
    axes = args.axes or (("roll", "pitch") if args.quality else ("yaw", "pitch"))
    return AngleGrid(*axes, *angles)


def attitudes_of(grid: AngleGrid, nadir_at_zero: np.ndarray) -> np.ndarray:
    """Return rotations (N, 3, 3) down to base at the angles of a grid."""
    x_rad, y_rad = (np.radians(angle) for angle in grid.mesh_deg())
    angles = dict.fromkeys(AXES, np.zeros(x_rad.size)) | {grid.x_name: x_rad, grid.y_name: y_rad}
    return rot_base_from_down(angles["roll"], angles["pitch"], angles["yaw"], nadir_at_zero)


def chosen_views(args: argparse.Namespace, rig: Rig) -> list[CameraView]:
    """Return the cameras to use. ValueError names the option that is wrong."""
    if args.cameras is None:
        return list(rig.views)
    views = {view.name: view for view in rig.views}
    names = [name.strip() for name in args.cameras.split(",")]
    for name in names:
        if name not in views:
            raise ValueError(
                f"--cameras: no camera {name!r} in {args.camera_file}; it has {', '.join(views)}"
            )
    return [views[name] for name in dict.fromkeys(names)]


def altitude_of(args: argparse.Namespace, rig: Rig) -> float:
    """Return the altitude to use, m. ValueError names the option or the file that is wrong."""
    altitude_m = rig.altitude_m if args.altitude is None else 1e3 * args.altitude
    if altitude_m is None:
        raise CameraFileError(
            f"{args.camera_file}: has no altitude_km; add it, or give --altitude KM"
        )
    if not rig.planet.limb_height_m < altitude_m < np.inf:
        raise ValueError(
            f"--altitude must be above the limb, {rig.planet.limb_height_m / 1e3:g} km, "
            f"got {altitude_m / 1e3:g}"
        )
    return altitude_m


def horizon_of(rig: Rig, altitude_m: float, samples: int = 720) -> np.ndarray:
    """Return rays (samples, 3) to the horizon from an altitude, as of `horizon_rays`."""
    return horizon_rays(rig.planet, altitude_m, samples, rig.latitude_rad, rig.heading_rad)


def check_noise(args: argparse.Namespace) -> None:
    """See that the noise of a limb point can be one. ValueError names the option that is wrong."""
    for option, value in (("--sigma", args.sigma), ("--trials", args.trials)):
        if not (value > 0 or (value == 0 and option == "--trials")):
            raise ValueError(f"{option} must be positive, got {value:g}")
