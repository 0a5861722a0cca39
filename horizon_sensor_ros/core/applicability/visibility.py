"""Field of applicability: which attitudes show the horizon to which camera, and how much of it.

Lomaka & Ustyugov (the field, figure 6) and the vertical builder of 2016 (two cameras, the error
over it) intersect the planet with the plane of the frame; here the horizon's own rays are projected
through the real camera, distortion included, and tested against the real frame. What the printed
approximation gives is in `section_circle`.

Frames: the *down* frame has its z axis towards the planet's centre; its x axis is the reference of
azimuth. An attitude is ``rot_base_from_down`` (3, 3), a map a stack of them (M, 3, 3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

_CELLS_AT_ONCE = 2048
_EDGE_BISECTIONS = 12


@dataclass(frozen=True, eq=False)
class Visibility:
    """The horizon in one camera's frame, one entry an attitude (M,).

    fraction : of the horizon's azimuth that is in the frame, 0 to 1.
    arc_px : length of the horizon's line in the frame, raw pixels; longest_px : of its longest
    contiguous arc; num_arcs : number of contiguous arcs.
    """

    fraction: np.ndarray
    arc_px: np.ndarray
    longest_px: np.ndarray
    num_arcs: np.ndarray

    @property
    def visible(self) -> np.ndarray:
        """(M,) bool: any horizon in the frame."""
        return self.num_arcs > 0


def cone_rays(rho_rad: float, samples: int = 720) -> np.ndarray:
    """Horizon rays (samples, 3) of a sphere in the down frame, once round in azimuth.

    They are the cone ``u . nadir = cos rho``. Raises ValueError for rho outside (0, pi/2) or fewer
    than 8 samples.
    """
    if not 0.0 < rho_rad < np.pi / 2:
        raise ValueError(f"rho_rad must be between 0 and pi/2, got {rho_rad}")
    if samples < 8:
        raise ValueError(f"samples must be at least 8, got {samples}")
    azimuth = 2 * np.pi * np.arange(samples) / samples
    sin_rho = np.sin(rho_rad)
    return np.column_stack(
        [
            sin_rho * np.cos(azimuth),
            sin_rho * np.sin(azimuth),
            np.full(samples, np.cos(rho_rad)),
        ]
    )


def horizon_rays(
    planet: Planet,
    altitude_m: float,
    samples: int = 720,
    latitude_rad: float = 0.0,
    heading_rad: float = 0.0,
) -> np.ndarray:
    """Rays (samples, 3) to the planet's limb in the down frame, equally spaced in azimuth.

    altitude_m : above the surface. Of an ellipsoid's limb latitude_rad (geodetic) and heading_rad
    count, the azimuth from north through east of the down frame's x axis; its z axis is geocentric
    nadir. A sphere has neither.
    Raises ValueError for an altitude that is not above the limb.
    """
    if not (np.isfinite(altitude_m) and altitude_m > planet.limb_height_m):
        raise ValueError(
            f"altitude_m must be above the limb at {planet.limb_height_m} m, got {altitude_m}"
        )
    if planet.flattening == 0:
        return cone_rays(planet.rho_from_altitude(altitude_m), samples)
    position = planet.ecef_from_geodetic(latitude_rad, 0.0, altitude_m)
    azimuth = heading_rad + 2 * np.pi * np.arange(samples) / samples
    nadir = planet.nadir_ecef(position)
    # At longitude 0 east is y, on the poles' axis too.
    east = np.array([0.0, 1.0, 0.0])
    north = np.cross(east, nadir)
    ahead = np.cos(heading_rad) * north + np.sin(heading_rad) * east
    rot_ecef_from_down = np.column_stack([ahead, np.cross(nadir, ahead), nadir])
    return planet.limb_rays_ecef(position, azimuth) @ rot_ecef_from_down


def rot_base_from_down(
    roll_rad: np.ndarray | float,
    pitch_rad: np.ndarray | float,
    yaw_rad: np.ndarray | float,
    nadir_at_zero: Sequence[float] | np.ndarray = (0.0, 0.0, -1.0),
) -> np.ndarray:
    """Attitudes (M, 3, 3) of a craft turned by ``Rz(yaw) Ry(pitch) Rx(roll)``.

    The angles (M,) broadcast. nadir_at_zero : nadir in the base frame at zero angles. A craft
    that flies level (x forward, z up) has (0, 0, -1), and yaw then changes nothing; the papers'
    craft, its long axis x upright, has (-1, 0, 0), and yaw and pitch are that axis' two tilts.
    At zero angles the down frame's x axis (azimuth 0) lies along the base's x axis, or along its
    z axis when x is upright.
    Raises ValueError when nadir_at_zero is not a unit vector.
    """
    down = np.asarray(nadir_at_zero, dtype=float)
    if down.shape != (3,) or not abs(np.linalg.norm(down) - 1.0) < 1e-6:
        raise ValueError(f"nadir_at_zero must be a unit vector of 3 elements, got {nadir_at_zero}")
    reference = np.array([1.0, 0.0, 0.0] if abs(down[0]) < 0.9 else [0.0, 0.0, 1.0])
    ahead = reference - (reference @ down) * down
    ahead /= np.linalg.norm(ahead)
    at_zero = np.column_stack([ahead, np.cross(down, ahead), down])

    roll, pitch, yaw = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(angle, dtype=float)) for angle in (roll_rad, pitch_rad, yaw_rad))
    )
    (cr, cp, cy), (sr, sp, sy) = (
        [function(angle) for angle in (roll, pitch, yaw)] for function in (np.cos, np.sin)
    )
    turned_from_base = np.empty((roll.size, 3, 3))
    turned_from_base[:, 0] = np.column_stack(
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr]
    )
    turned_from_base[:, 1] = np.column_stack(
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr]
    )
    turned_from_base[:, 2] = np.column_stack([-sp, cp * sr, cp * cr])
    return np.swapaxes(turned_from_base, 1, 2) @ at_zero


def horizon_in_view(view: CameraView, rays_down: np.ndarray, attitudes: np.ndarray) -> Visibility:
    """How much of the horizon the camera sees at each attitude.

    rays_down : (N, 3) unit rays to the horizon in the down frame, closed, equally spaced in azimuth
    (`cone_rays`, or a planet's own limb). attitudes : (M, 3, 3) rot_base_from_down.
    The ends of every arc are refined between samples; an arc that lies wholly between two
    neighbouring samples is missed. Raises ValueError for wrong shapes.
    """
    rays_down = np.asarray(rays_down, dtype=float)
    attitudes = np.asarray(attitudes, dtype=float)
    if rays_down.ndim != 2 or rays_down.shape[1] != 3:
        raise ValueError(f"rays_down must have shape (N, 3), got {rays_down.shape}")
    if attitudes.ndim != 3 or attitudes.shape[1:] != (3, 3):
        raise ValueError(f"attitudes must have shape (M, 3, 3), got {attitudes.shape}")
    rot_cam_from_down = view.rot_base_from_cam.T @ attitudes
    cos_field = np.cos(_field_angle_rad(view.camera))
    parts = [
        _measure(view.camera, cos_field, rays_down, rot_cam_from_down[i : i + _CELLS_AT_ONCE])
        for i in range(0, len(attitudes), _CELLS_AT_ONCE)
    ]
    columns = (
        [np.concatenate(column) for column in zip(*parts, strict=True)]
        if parts
        else [np.empty(0), np.empty(0), np.empty(0), np.empty(0, dtype=int)]
    )
    return Visibility(*columns)


def limb_in_view(
    view: CameraView,
    rays_down: np.ndarray,
    attitude: np.ndarray,
    sigma_px: float = 0.1,
    spacing_px: float = 1.0,
) -> LimbPoints:
    """Exact limb points of one camera at one attitude (3, 3): samples of the horizon.

    Nothing is interpolated: there is one point for every spacing_px of the horizon's line, as far
    as rays_down is that dense. Each is given the standard deviation sigma_px but carries no noise.
    Status NO_LIMB when the horizon is outside the frame.
    """
    rot_cam_from_down = view.rot_base_from_cam.T @ np.asarray(attitude, dtype=float)
    rays_all = rays_down @ rot_cam_from_down.T
    near = np.flatnonzero(rays_all[:, 2] >= np.cos(_field_angle_rad(view.camera)))
    px_near = view.camera.pixels(rays_all[near])
    inside = view.camera.in_frame(px_near)
    sample, px = near[inside], px_near[inside]
    if sample.size == 0:
        return LimbPoints.none(Status.NO_LIMB, "the horizon is outside the frame")
    steps = np.hypot(*np.diff(px, axis=0, prepend=px[:1]).T)
    bins = np.floor(np.cumsum(steps) / spacing_px)
    keep = np.flatnonzero(np.diff(bins, prepend=-1.0) > 0)
    sample, px = sample[keep], px[keep]
    count = len(rays_all)
    along = rays_all[(sample + 1) % count] - rays_all[(sample - 1) % count]
    jacobian = view.camera.pixel_jacobian(rays_all[sample])
    tangent = np.einsum("nij,nj->ni", jacobian, along)
    outwards = -(jacobian @ rot_cam_from_down[:, 2])
    normal = np.column_stack([tangent[:, 1], -tangent[:, 0]])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= np.sign(np.sum(normal * outwards, axis=1, keepdims=True))
    return LimbPoints(Status.OK, "", px, normal, np.full(len(px), float(sigma_px)))


def _field_angle_rad(camera: Camera) -> float:
    """Largest angle off the axis in the frame: on the border, or the model's limit."""
    right, bottom = camera.width - 0.5, camera.height - 0.5
    x = np.linspace(-0.5, right, 65)
    y = np.linspace(-0.5, bottom, 65)
    border = np.concatenate(
        [
            np.column_stack([x, np.full(65, -0.5)]),
            np.column_stack([x, np.full(65, bottom)]),
            np.column_stack([np.full(65, -0.5), y]),
            np.column_stack([np.full(65, right), y]),
        ]
    )
    rays = camera.rays(border)
    if np.isnan(rays).any():
        return camera.max_angle_rad
    # The border between two of these samples may lie a little farther out.
    return min(camera.max_angle_rad, float(np.arccos(rays[:, 2].min())) + 0.01)


def _measure(
    camera: Camera, cos_field: float, rays_down: np.ndarray, rot_cam_from_down: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Columns of `Visibility` for one batch of attitudes.

    Samples are numbered cell * N + azimuth index, so that only those inside the frame are kept.
    """
    cells, count = len(rot_cam_from_down), len(rays_down)
    near = np.flatnonzero(rot_cam_from_down[:, 2] @ rays_down.T >= cos_field)
    px = _projected(camera, rot_cam_from_down, near // count, rays_down[near % count])
    seen = camera.in_frame(px)
    sample, px = near[seen], px[seen]
    cell, azimuth = np.divmod(sample, count)
    fraction, arc, longest = np.zeros(cells), np.zeros(cells), np.zeros(cells)
    arcs = np.zeros(cells, dtype=int)
    if sample.size == 0:
        return fraction, arc, longest, arcs

    following = cell * count + (azimuth + 1) % count
    preceding = cell * count + (azimuth - 1) % count
    at_next = np.minimum(np.searchsorted(sample, following), sample.size - 1)
    goes_on = sample[at_next] == following
    comes_on = np.isin(preceding, sample, assume_unique=True)

    # Lengths that belong to each sample: to the next one, or to the frame's border on either side.
    length = np.where(goes_on, np.hypot(*(px[at_next] - px).T), 0.0)
    share = goes_on.astype(float)
    for end, beyond in ((~goes_on, following), (~comes_on, preceding)):
        length_px, part = _to_the_border(
            camera, rot_cam_from_down, rays_down, sample[end], beyond[end], px[end]
        )
        length[end] += length_px
        share[end] += part

    # Contiguous arcs; one that runs over azimuth zero is the row's last and first together.
    label = np.cumsum(~comes_on | (np.diff(cell, prepend=-1) > 0)) - 1
    wraps = goes_on & (azimuth == count - 1)
    joined = np.arange(label[-1] + 1)
    joined[label[wraps]] = label[at_next[wraps]]
    label = joined[label]
    arc_of_label = np.bincount(label, weights=length)
    fraction += np.bincount(cell, weights=share, minlength=cells) / count
    arc += np.bincount(cell, weights=length, minlength=cells)
    np.maximum.at(longest, cell, arc_of_label[label])
    first = np.unique(label, return_index=True)[1]
    arcs += np.bincount(cell[first], minlength=cells)
    return fraction, arc, longest, arcs


def _to_the_border(
    camera: Camera,
    rot_cam_from_down: np.ndarray,
    rays_down: np.ndarray,
    sample: np.ndarray,
    beyond: np.ndarray,
    px: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """How far (E,) the horizon goes on from samples at pixels (E, 2) before it leaves the frame on
    its way to others beyond, by number: pixels, and share of the way.
    """
    count = len(rays_down)
    cell, at = np.divmod(sample, count)
    inner, outer = rays_down[at], rays_down[beyond % count]
    # Second difference: between samples the horizon bends, which counts where it grazes a side.
    bend = 0.5 * (rays_down[(at + 1) % count] - 2 * inner + rays_down[(at - 1) % count])
    low, high = np.zeros(inner.shape[0]), np.ones(inner.shape[0])
    last = px.copy()
    for _ in range(_EDGE_BISECTIONS):
        middle = 0.5 * (low + high)
        t = middle[:, None]
        rays = inner + t * (outer - inner) + t * (t - 1) * bend
        trial = _projected(camera, rot_cam_from_down, cell, rays)
        inside = camera.in_frame(trial)
        last[inside] = trial[inside]
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return np.hypot(*(last - px).T), low


def _projected(
    camera: Camera, rot_cam_from_down: np.ndarray, cell: np.ndarray, rays: np.ndarray
) -> np.ndarray:
    """Pixels (E, 2) of rays (E, 3), down frame, at the attitudes with these numbers (E,)."""
    return camera.pixels(np.einsum("nij,nj->ni", rot_cam_from_down[cell], rays))
