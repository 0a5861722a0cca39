"""Points on edges, each with the line that the edge is there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.mathematics.columns import column_dots
from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage
from horizon_sensor_ros.core.target_motion.surfaces.planes import Planes


@dataclass(frozen=True, eq=False)
class Edges:
    """E points on edges: ends of faces, both sides of thin parts, and creases.

    points : (E, 3).  sides : (E, 3) unit normals of the plane through the sensor and the edge,
        away from the surface.  directions : (E, 3) unit vectors along the edge.
    sigma_m : (E,) across the edge.  range_noise_m : (E, 3) one sigma along the ray, as if each
        point had its own; seen from elsewhere, that is across the edge as well.
    fronts : (E, 3) unit normals towards the sensor, across the part, where it is thin (a line);
        NaN elsewhere.
    rough_m : (E,) scatter of the returns about that line, along its front, beyond the noise; 0
        where there is none.  tilt_rad : (E,) error of the front that comes of it.
    half_width_m : (E,) of the narrow face that it ends; 0 where it ends none.
    creases : (E,) bool, where the face meets another one that is seen as well. Each is there
        twice, as the end of either face.
    run : (E,) number of the run of places that err together across it.  alike_m : (E,) one sigma of
        what all of a run is off by.  leaning_m : (E,) and of what it is off by as it leans, with
        its sign: a straight line through 0 in the middle of the run.  0 where there is none.
    """

    points: np.ndarray
    sides: np.ndarray
    directions: np.ndarray
    sigma_m: np.ndarray
    range_noise_m: np.ndarray
    fronts: np.ndarray
    rough_m: np.ndarray
    tilt_rad: np.ndarray
    half_width_m: np.ndarray
    creases: np.ndarray
    run: np.ndarray
    alike_m: np.ndarray
    leaning_m: np.ndarray

    def __len__(self) -> int:
        return len(self.points)


def no_edges() -> Edges:
    """None at all."""
    empty = np.empty((0, 3))
    none = np.empty(0)
    one = np.empty(0, np.int32)
    return Edges(
        empty, empty, empty, none, empty, empty, none, none, none, np.empty(0, bool), one, none,
        none,
    )  # fmt: skip


def in_space(
    image: RangeImage,
    place: np.ndarray,
    inverse_depth: np.ndarray,
    slope: np.ndarray,
    along: np.ndarray,
    across: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rays (depth 1), points, side normals and directions, (3, N) each, of lines in the image.

    place, along, across : (2, N) pixels.  slope : of inverse depth, a pixel along the line.
    """
    ray = np.ones((3, place.shape[1]))
    ray[:2] = image.origin[:, None] + place / image.focal_px
    side = np.array([across[0], across[1], -column_dots(across, ray[:2])])
    side /= np.sqrt(column_dots(side, side))
    # d point / d s, but for its length.
    direction = ray * (-slope / inverse_depth)
    direction[:2] += along / image.focal_px
    direction /= np.sqrt(column_dots(direction, direction))
    return ray, ray / inverse_depth, side, direction


def range_noise(planes: Planes, pixel: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """(3, N) `Edges.range_noise_m` where planes end, half a pixel beyond flat indices (N,), along
    rays (3, N) of depth 1.

    A plane is told there by the rows of pixels that half a window reaches back: a straight line
    through n of them is known to 4 / n of one's variance beyond its end.
    """
    noise, level = planes.noise.ravel()[pixel], planes.level.ravel()[pixel]
    return along_ray(ray, noise / (level * level) * np.sqrt(4.0 / (planes.radius_px + 1)))


def along_ray(ray: np.ndarray, range_m: float | np.ndarray) -> np.ndarray:
    """(3, N) ranges, (N,) or one, along rays (3, N)."""
    return np.asarray(ray * (range_m / np.sqrt(column_dots(ray, ray))))
