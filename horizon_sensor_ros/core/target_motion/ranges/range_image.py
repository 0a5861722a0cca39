"""Any point cloud as a small pinhole image of inverse depth, in which a plane is a linear
function.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.ranges.field_of_view import (
    likely_frame,
    outside_circle,
    outside_lines,
)
from horizon_sensor_ros.core.target_motion.ranges.grid import (
    Grid,
    not_far_off,
    organised_grid,
    plain_grid,
)
from horizon_sensor_ros.core.target_motion.ranges.own_frame import MOST_M, sensor_of_returns
from horizon_sensor_ros.core.target_motion.ranges.pixel_values import depth_in_middles
from horizon_sensor_ros.core.target_motion.ranges.range_step import step_of_ranges

_MARGIN_PX = 8
STEEPEST = 5.0
# Of returns strewn at random, two to a pixel, a seventh has an empty pixel next to it before the
# next return on its surface, looked for so far along its row or column and up to such a slope; of
# those on bars up to a fifth. Of lines that a lidar scans with room between, more.
_LINE_GAPS, _LINE_REACH_PX, _LINE_SLOPE = 0.23, 5, 2.0


@dataclass(frozen=True, eq=False)
class RangeImage:
    """Inverse depth over a regular grid of viewing directions (x/z, y/z), cropped to what was
    returned.

    status, reason : OK, or why the cloud is of no use; the rest is then empty.
    inverse_depth : (H, W) float32, 1/m; 0 where there is no return.
    unknown : (H, W) bool, where nothing may be concluded from a missing return: speckle that was
        taken out, and directions outside the sensor's frame.
    mixed : (H, W) bool, beside returns, where one that lay between them and what is behind was
        cropped: a surface that ends before it covers a part of that pixel.
    focal_px : pixels of this image a unit of (x/z, y/z).
    origin : (x/z, y/z) of pixel (column 0, row 0).
    num_points : returns in the cloud, see `range_image`.  num_used : pixels with a return.
    centroid_m : (3,) of these points, in the view frame.
    range_step_m : of a sensor that tells ranges, depths or disparities in whole steps; 0: none.
    on_grid : whether the pixels are the sensor's own; those made for a cloud that lies on no grid
        were not all looked at.
    in_lines : (2,) bool, whether along the rows, and along the columns, such a cloud has room
        between lines of returns.
    rot_sensor_from_view : (3, 3); the image is taken along z of the view frame, which is the
        cloud's own unless the target lies more than 45 deg off its z axis (a lidar's frame with x
        forward), or the cloud was brought into another frame than the sensor's.
    sensor_m : (3,) where the sensor is in the cloud's frame; 0 unless that is another one.
    """

    status: Status
    reason: str
    inverse_depth: np.ndarray
    unknown: np.ndarray
    mixed: np.ndarray
    focal_px: float
    origin: np.ndarray
    num_points: int
    num_used: int
    centroid_m: np.ndarray
    range_step_m: float
    on_grid: bool
    in_lines: np.ndarray
    rot_sensor_from_view: np.ndarray
    sensor_m: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def same_as(self, other: RangeImage) -> bool:
        """Whether both are of the same returns, to the last bit."""
        # The mean tells nearly all others apart, at no cost.
        return (
            self.num_points == other.num_points
            and np.array_equal(self.centroid_m, other.centroid_m)
            and np.array_equal(self.inverse_depth, other.inverse_depth)
        )

    def tangents(self) -> tuple[np.ndarray, np.ndarray]:
        """x/z of the columns (W,) and y/z of the rows (H,)."""
        height, width = self.inverse_depth.shape
        return (
            self.origin[0] + np.arange(width) / self.focal_px,
            self.origin[1] + np.arange(height) / self.focal_px,
        )

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Which of the points (N, 3), metres, in the cloud's frame, fall into the image (M,), by
        number; their flat pixels (M,) and depths (M,) in it.
        """
        with np.errstate(invalid="ignore", over="ignore"):  # of garbled messages
            away = np.array(points.T, np.float64, order="C") - self.sensor_m[:, None]
            x, y, z = self.rot_sensor_from_view.T @ away
            which = np.flatnonzero(z > 0.2 * np.maximum(np.abs(x), np.abs(y)))
        x, y, z = x[which], y[which], z[which]
        column = np.rint((x / z - self.origin[0]) * self.focal_px).astype(np.int64)
        row = np.rint((y / z - self.origin[1]) * self.focal_px).astype(np.int64)
        height, width = self.inverse_depth.shape
        inside = np.flatnonzero((row >= 0) & (row < height) & (column >= 0) & (column < width))
        return which[inside], (row * width + column)[inside], z[inside]


def cloud_of(points: np.ndarray) -> np.ndarray:
    """Return points as an array; ValueError where they are neither (H, W, 3) nor (N, 3)."""
    points = np.asarray(points)
    if points.ndim not in (2, 3) or points.shape[-1] != 3:
        raise ValueError(f"points must be (H, W, 3) or (N, 3), got shape {points.shape}")
    return points


def range_image(
    points: np.ndarray, focal_px: float | None = None, min_points: int = 100
) -> RangeImage:
    """Bring a cloud into a range image.

    points : (H, W, 3) organised or (N, 3) plain, metres, sensor frame with z forward. No returns
        are those that are not finite, within a millimetre of the sensor, 10 km off and more, or
        five times as far to a side of the view as ahead.
    focal_px : focal length of the sensor in pixels; None: estimated from the spacing of the points.
    An organised cloud that is no pinhole image (a scanning lidar's) is treated as a plain one;
    one that was brought into another frame is first brought back.
    Raises ValueError for another shape or a focal length that is not positive.
    """
    points = cloud_of(points)
    if focal_px is not None and not focal_px > 0:
        raise ValueError(f"focal_px must be positive, got {focal_px}")
    image = _as_seen_from_zero(points, focal_px, min_points)
    if points.ndim == 2 or (image.status is Status.OK and image.on_grid):
        return image
    found = sensor_of_returns(points)
    if found is None:
        return image
    rotation, sensor_m = found
    with np.errstate(invalid="ignore", over="ignore"):  # of garbled messages
        brought = (points - sensor_m) @ rotation
    # No returns that were zeros in the frame of the cloud.
    brought[~points.any(axis=-1)] = np.nan
    seen = _as_seen_from_zero(brought, focal_px, min_points)
    if seen.status is not Status.OK or not seen.on_grid:
        return image
    return replace(
        seen, rot_sensor_from_view=rotation @ seen.rot_sensor_from_view, sensor_m=sensor_m
    )


def _as_seen_from_zero(points: np.ndarray, focal_px: float | None, min_points: int) -> RangeImage:
    """The image of a cloud whose frame has the sensor at its origin."""
    flat = points.reshape(-1, 3)
    # Depth first: of an organised cloud most points have none.
    place = np.flatnonzero(np.isfinite(flat[:, 2]))
    with np.errstate(invalid="ignore"):  # signalling NaN, of garbled messages
        used = np.array(flat.take(place, axis=0).T, np.float64, order="C")
    size = np.abs(used).max(axis=0)
    # Sensors that fill missing returns with zeros do so exactly; NaN fails both.
    keep = (size > 1e-3) & (size < MOST_M)
    if not keep.all():
        place, used, size = place[keep], used[:, keep], size[keep]
    view = _view_rotation(used)
    if view is not None:
        used = view.T @ used
    ahead = used[2] > 0.2 * size
    if not ahead.all():
        place, used = place[ahead], used[:, ahead]
    if len(place) < min_points:
        what = "finite points ahead of the sensor"
        return _refused(
            Status.TOO_FEW_POINTS, f"{len(place)} {what}, {min_points} needed", len(place)
        )
    tangent = used[:2] / used[2]
    count = len(place)
    if points.ndim == 3 and view is None:
        grid = organised_grid(tangent, place, points.shape[:2])
        if grid is not None:
            height, width = points.shape[:2]
            frame = np.array([0, 0, width - 1, height - 1])
            return _assemble(used, tangent, grid, frame, None, count, min_points)
    near = not_far_off(tangent)
    if not near.all():
        used, tangent = used[:, near], tangent[:, near]
    if not (np.ptp(tangent, axis=1) > 1e-6).all():
        return _refused(
            Status.TOO_FEW_POINTS, "the directions to the points lie on one line", count
        )
    grid = plain_grid(tangent, focal_px)
    return _assemble(used, tangent, grid, None, view, count, min_points)


def _refused(status: Status, reason: str, num_points: int) -> RangeImage:
    empty = np.zeros((0, 0), np.float32)
    nowhere = np.full(3, np.nan)
    return RangeImage(
        status,
        reason,
        inverse_depth=empty,
        unknown=empty > 0,
        mixed=empty > 0,
        focal_px=1.0,
        origin=np.zeros(2),
        num_points=num_points,
        num_used=0,
        centroid_m=nowhere,
        range_step_m=0.0,
        on_grid=True,
        in_lines=np.zeros(2, bool),
        rot_sensor_from_view=np.eye(3),
    )


def _view_rotation(points: np.ndarray) -> np.ndarray | None:
    """None where z is the forward axis of (3, N) points; else the axis swap (3, 3) that makes it
    so.
    """
    if not points.size:
        return None
    centre = points.mean(axis=1)
    axis = int(np.argmax(np.abs(centre)))
    if axis == 2 and centre[2] > 0:
        return None
    forward = np.eye(3)[axis] * np.sign(centre[axis])
    right = np.eye(3)[(axis + 1) % 3]
    return np.column_stack([right, np.cross(forward, right), forward])


def _assemble(
    used: np.ndarray,
    tangent: np.ndarray,
    grid: Grid,
    frame: np.ndarray | None,
    view: np.ndarray | None,
    num_points: int,
    min_points: int,
) -> RangeImage:
    if not grid.on.all():
        used, tangent = used[:, grid.on], tangent[:, grid.on]
        grid = replace(grid, pixel=grid.pixel[:, grid.on], on=grid.on[grid.on])
    if not len(grid.on):
        return _refused(Status.TOO_FEW_POINTS, "no points on the grid", num_points)
    pixel, focal, origin = grid.pixel, grid.focal_px, grid.origin
    low = pixel.min(axis=1) - _MARGIN_PX
    width, height = (int(side) for side in pixel.max(axis=1) + _MARGIN_PX + 1 - low)
    index = pixel[1] * width + (pixel[0] - (low[1] * width + low[0]))
    offset = (tangent - origin[:, None]) * focal - pixel
    inverse = depth_in_middles(1 / used[2], index, offset, (height, width), STEEPEST / focal)
    frame = (
        likely_frame(inverse, _MARGIN_PX) if frame is None else frame - np.concatenate([low, low])
    )
    unknown = np.zeros((height, width), bool)
    unknown[: max(frame[1], 0)] = True
    unknown[frame[3] + 1 :] = True
    unknown[:, : max(frame[0], 0)] = True
    unknown[:, frame[2] + 1 :] = True
    if not grid.own:
        unknown |= outside_circle(inverse, origin * focal + low)
    if view is not None:
        unknown |= outside_lines(inverse, origin + low / focal, focal, view)
    speckle = _speckle(inverse, focal)
    inverse[speckle] = 0
    unknown |= speckle
    count = int(np.count_nonzero(inverse))
    if count < min_points:
        reason = f"{count} separate directions hang together, {min_points} needed"
        return _refused(Status.TOO_FEW_POINTS, reason, num_points)
    corner = origin + low / focal
    centre = used.mean(axis=1)
    turn = np.eye(3) if view is None else view
    return RangeImage(
        Status.OK,
        "",
        inverse_depth=inverse,
        unknown=unknown,
        mixed=np.zeros((height, width), bool),
        focal_px=focal,
        origin=corner,
        num_points=num_points,
        num_used=count,
        centroid_m=centre,
        range_step_m=step_of_ranges(used),
        on_grid=grid.own,
        in_lines=np.zeros(2, bool) if grid.own else _in_lines(inverse, focal),
        rot_sensor_from_view=turn,
    )


def _in_lines(inverse: np.ndarray, focal: float) -> np.ndarray:
    """(2,) bool, whether along the rows and along the columns many returns have the next one of
    their surface beyond empty pixels.
    """
    share = np.zeros(2)
    for way, image in enumerate((inverse, inverse.T)):
        here = image[:, :-_LINE_REACH_PX]
        alone = here > 0
        met = []
        for ahead in range(1, _LINE_REACH_PX + 1):
            there = image[:, ahead : ahead - _LINE_REACH_PX or None]
            near = np.abs(there - here) < here * np.float32(_LINE_SLOPE * ahead / focal)
            met.append(np.count_nonzero(alone & near & (there > 0)))
            alone &= there == 0
        share[way] = 1 - met[0] / max(sum(met), 1)
    return share > _LINE_GAPS


def _speckle(inverse: np.ndarray, focal: float) -> np.ndarray:
    """Returns that fewer than two of the eight neighbours share: outliers and mixed pixels."""
    width = inverse.shape[1]
    # No return is far from every return. The margin keeps rows from running into each other.
    level = np.where(inverse > 0, inverse, np.float32(-1e9)).ravel()
    seen = level > 0
    tolerance = level * np.float32(STEEPEST / focal) + np.float32(1e-6)
    step = np.abs(level[1:] - level[:-1])[seen[1:] & seen[:-1]]
    if step.size:
        # Ranges noisier than the pixels are wide: half of all neighbours differ by less than the
        # median.
        tolerance = np.maximum(tolerance, 6 * np.partition(step, len(step) // 2)[len(step) // 2])
    tolerance[~seen] = -1
    count = np.zeros(inverse.size, np.uint8)
    for ahead in (1, width - 1, width, width + 1):
        near = np.abs(level[:-ahead] - level[ahead:]) < tolerance[:-ahead]
        count[:-ahead] += near
        count[ahead:] += near
    return (seen & (count < 2)).reshape(inverse.shape)
