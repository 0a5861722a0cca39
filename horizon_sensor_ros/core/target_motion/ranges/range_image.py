"""Any point cloud as a small pinhole image of inverse depth, in which a plane is a linear
function."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from horizon_sensor_ros.core.mathematics.robust import quantile
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.ranges.pixel_values import depth_in_middles
from horizon_sensor_ros.core.target_motion.ranges.regular import MOST_OFF, ON_GRID, grid_of

_MARGIN_PX = 8
_MAX_COORDINATE_M = 1e4
_MAX_SIDE_PX = 400
_STEEPEST = 5.0
# A point of an organised cloud may lie so far from its pixel's middle; half a pixel on the next one
# begins.
_ORGANISED_OFF_PX = 0.45
# On a regular grid, square or twice as wide as high, the disc to this neighbour holds as many
# points as it has room for, within a twentieth.
_NEIGHBOURS = 12
# Of returns strewn at random, two to a pixel, a seventh has an empty pixel next to it before the
# next return on its surface, looked for so far along its row or column and up to such a slope; of
# those on bars up to a fifth. Of lines that a lidar scans with room between, more.
_LINE_GAPS, _LINE_REACH_PX, _LINE_SLOPE = 0.23, 5, 2.0
# Of the pixels that hold a return in any of the rows next to the frame, those that do in the last
# one, and how many at least: of a round outline less than 0.58 do, of a straight one a third that
# rises by three pixels.
_FRAME_SHARE, _FRAME_ROWS, _FRAME_LEAST = 0.6, 3, 5
# Of what is seen, columns that end within a pixel of the same elevation.
_CUT_SHARE = 0.5
# By how much their line bends, rounded to pixels: less, and it may be a straight edge.
_BENT_PX = 1.5
# A straight edge lies within a pixel of the circle that touches it over twice the root of twice its
# radius, in pixels; a round field's outline over this many times as much, at least.
_ROUND_SHARE, _ROUND_PX = 1.3, 1.0
# Smallest step of ranges that is still looked for, and the points it is looked for in.
_SMALLEST_STEP_M, _STEP_POINTS = 5e-4, 2000
# And of disparity, at the median depth.
_DISPARITY_STEPS_M = 1e-3


@dataclass(frozen=True, eq=False)
class RangeImage:
    """Inverse depth over a regular grid of viewing directions (x/z, y/z), cropped to what was
    returned.

    status, reason : OK, or why the cloud is of no use; the rest is then empty.
    inverse_depth : (H, W) float32, 1/m; 0 where there is no return.
    unknown : (H, W) bool, where nothing may be concluded from a missing return: speckle that was
        taken out, and directions outside the sensor's frame.
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
        sensor's own unless the target lies more than 45 deg off its z axis (a lidar's frame with x
        forward).
    """

    status: Status
    reason: str
    inverse_depth: np.ndarray
    unknown: np.ndarray
    focal_px: float
    origin: np.ndarray
    num_points: int
    num_used: int
    centroid_m: np.ndarray
    range_step_m: float
    on_grid: bool
    in_lines: np.ndarray
    rot_sensor_from_view: np.ndarray

    def tangents(self) -> tuple[np.ndarray, np.ndarray]:
        """x/z of the columns (W,) and y/z of the rows (H,)."""
        height, width = self.inverse_depth.shape
        return (
            self.origin[0] + np.arange(width) / self.focal_px,
            self.origin[1] + np.arange(height) / self.focal_px,
        )


def cloud_of(points: np.ndarray) -> np.ndarray:
    """Return points as an array; ValueError where they are neither (H, W, 3) nor (N, 3)."""
    points = np.asarray(points)
    if points.ndim not in (2, 3) or points.shape[-1] != 3:
        raise ValueError(f"points must be (H, W, 3) or (N, 3); got shape {points.shape}")
    return points


def range_image(
    points: np.ndarray, focal_px: float | None = None, min_points: int = 100
) -> RangeImage:
    """Bring a cloud into a range image.

    points : (H, W, 3) organised or (N, 3) plain, metres, sensor frame with z forward. No returns
        are those that are not finite, within a millimetre of the sensor, 10 km off and more, or
        five times as far to a side of the view as ahead.
    focal_px : focal length of the sensor in pixels; None: estimated from the spacing of the points.
    An organised cloud that is no pinhole image (a scanning lidar's) is treated as a plain one.
    Raises ValueError for another shape or a focal length that is not positive.
    """
    points = cloud_of(points)
    if focal_px is not None and not focal_px > 0:
        raise ValueError(f"focal_px must be positive; got {focal_px}")
    flat = points.reshape(-1, 3)
    # Depth first: of an organised cloud most points have none.
    place = np.flatnonzero(np.isfinite(flat[:, 2]))
    with np.errstate(invalid="ignore"):  # signalling NaN, of garbled messages
        used = np.array(flat.take(place, axis=0).T, np.float64, order="C")
    size = np.abs(used).max(axis=0)
    # Sensors that fill missing returns with zeros do so exactly; NaN fails both.
    keep = (size > 1e-3) & (size < _MAX_COORDINATE_M)
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
        grid = _organised_grid(tangent, place, points.shape[:2])
        if grid is not None:
            height, width = points.shape[:2]
            frame = np.array([0, 0, width - 1, height - 1])
            return _assemble(used, tangent, grid, frame, None, count, min_points)
    near = _not_far_off(tangent)
    if not near.all():
        used, tangent = used[:, near], tangent[:, near]
    if not (np.ptp(tangent, axis=1) > 1e-6).all():
        return _refused(
            Status.TOO_FEW_POINTS, "the directions to the points lie on one line", count
        )
    grid = _plain_grid(tangent, focal_px)
    return _assemble(used, tangent, grid, None, view, count, min_points)


def _refused(status: Status, reason: str, num_points: int) -> RangeImage:
    empty = np.zeros((0, 0), np.float32)
    nowhere = np.full(3, np.nan)
    return RangeImage(
        status,
        reason,
        empty,
        empty > 0,
        1.0,
        np.zeros(2),
        num_points,
        0,
        nowhere,
        0.0,
        True,
        np.zeros(2, bool),
        np.eye(3),
    )


def _view_rotation(points: np.ndarray) -> np.ndarray | None:
    """None where z is the forward axis of (3, N) points; else the axis swap (3, 3) that makes it
    so."""
    if not points.size:
        return None
    centre = points.mean(axis=1)
    axis = int(np.argmax(np.abs(centre)))
    if axis == 2 and centre[2] > 0:
        return None
    forward = np.eye(3)[axis] * np.sign(centre[axis])
    right = np.eye(3)[(axis + 1) % 3]
    return np.column_stack([right, np.cross(forward, right), forward])


def _not_far_off(tangent: np.ndarray) -> np.ndarray:
    """(N,) bool, false for the odd point far from all others, which the grid need not reach."""
    some = tangent[:, :: max(1, tangent.shape[1] // 2000)]
    low, high = (
        np.array([quantile(axis, share) for axis in some]) for share in (1 - ON_GRID, ON_GRID)
    )
    middle = (low + high)[:, None] / 2
    return _larger(np.abs(tangent - middle)) <= 2.5 * (high - low).max()


def _larger(two: np.ndarray) -> np.ndarray:
    """(N,) of (2, N); faster than a reduction."""
    return np.maximum(two[0], two[1])


@dataclass(frozen=True, eq=False)
class _Grid:
    """Pixels of points: (2, N) int column and row; the direction of pixel (0, 0); which points
    (N,) bool lie on the grid; whether it is the points' own, not made for them."""

    pixel: np.ndarray
    focal_px: float
    origin: np.ndarray
    on: np.ndarray
    own: bool = True


def _organised_grid(tangent: np.ndarray, place: np.ndarray, shape: tuple[int, int]) -> _Grid | None:
    """Grid of a pinhole camera's cloud, or None where it is not one: columns and rows are linear in
    x/z and y/z, and pixels are square."""
    row, column = np.divmod(place, shape[1])
    pixel = np.stack([column, row])
    step = max(1, len(place) // 2000)
    index, some = pixel[:, ::step].astype(float), tangent[:, ::step]
    line = _lines(index, some)
    if line is not None:
        # Again without the points that lie off, which pull the lines.
        off = _larger(np.abs(some - line[0][:, None] * index - line[1][:, None]))
        good = off <= quantile(off, ON_GRID)
        line = _lines(index[:, good], some[:, good])
    if line is None:
        return None
    slope, origin = line
    if not (slope > 0).all() or abs(slope[0] / slope[1] - 1) > 0.02:
        return None
    return _square_grid(tangent, pixel, slope, origin, _ORGANISED_OFF_PX)


def _square_grid(
    tangent: np.ndarray, pixel: np.ndarray, pitch: np.ndarray, origin: np.ndarray, most_px: float
) -> _Grid | None:
    """Grid of pixels (2, N) with the mean of both pitches (2,), or None where too many points lie
    farther than that from their pixels' middles."""
    mean = float(pitch.mean())
    middle = pixel.mean(axis=1)
    origin = origin + (pitch - mean) * middle
    off = _larger(np.abs(tangent - mean * pixel - origin[:, None])) / mean
    if quantile(off, ON_GRID) > most_px:
        return None
    return _Grid(pixel, 1 / mean, origin, off < 0.5)


def _lines(index: np.ndarray, tangent: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Slopes and values at 0 (2,) of the lines tangent (2, N) over index (2, N)."""
    mean_i, mean_t = index.mean(axis=1), tangent.mean(axis=1)
    arm = index - mean_i[:, None]
    spread = (arm * arm).sum(axis=1)
    if not (spread > 0).all():
        return None
    slope = (tangent * arm).sum(axis=1) / spread
    return slope, mean_t - slope * mean_i


def _plain_grid(tangent: np.ndarray, focal_px: float | None) -> _Grid:
    """Grid for points in any order.

    Where the directions lie on a regular grid (a camera's cloud without its empty pixels) that
    grid is found and every point gets its own pixel; otherwise the pixels are made coarse enough
    to leave few holes.
    """
    extent = float(np.ptp(tangent, axis=1).max())
    expected = 1 / focal_px if focal_px else None
    grid = [grid_of(tangent[axis], expected, extent / _MAX_SIDE_PX) for axis in (0, 1)]
    if grid[0] is not None and grid[1] is not None:
        pitch, origin = np.transpose([grid[0], grid[1]])
        if abs(pitch[0] / pitch[1] - 1) < 0.02:
            pixel = np.rint((tangent - origin[:, None]) / pitch[:, None]).astype(np.int64)
            square = _square_grid(tangent, pixel, pitch, origin, MOST_OFF)
            if square is not None:
                return square
    distance, area = _spacing(tangent, extent)
    # Points strewn at random: some two to a pixel leave one in seven empty.
    pitch = max(2 * distance, extent / _MAX_SIDE_PX, np.sqrt(2 * area))
    origin = tangent.min(axis=1)
    pixel = np.rint((tangent - origin[:, None]) / pitch).astype(np.int64)
    return _Grid(pixel, 1 / pitch, origin, np.ones(tangent.shape[1], bool), False)


def _spacing(tangent: np.ndarray, extent: float) -> tuple[float, float]:
    """Median distance of a point to its nearest other one, and the area that each has about it; of
    at most 500 of them.

    The area is that of the disc to the k-th neighbour over k. What the target leaves empty of the
    box around it (beside an antenna, between the arms of a cross) does not count.
    """
    from scipy.spatial import cKDTree  # noqa: PLC0415  a camera's clouds do without it

    cell = np.rint((tangent - tangent.min(axis=1)[:, None]) * (1e6 / extent)).astype(np.int64)
    unique = tangent.T[np.unique(cell[0] * 2_000_003 + cell[1], return_index=True)[1]]
    sample = unique[:: max(1, len(unique) // 500)]
    last = min(_NEIGHBOURS, len(unique) - 1)
    distance = np.median(cKDTree(unique).query(sample, k=[2, last + 1])[0], axis=0)
    return float(distance[0]), float(np.pi * distance[1] ** 2 / last)


def _assemble(
    used: np.ndarray,
    tangent: np.ndarray,
    grid: _Grid,
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
    inverse = depth_in_middles(1 / used[2], index, offset, (height, width), _STEEPEST / focal)
    frame = _likely_frame(inverse) if frame is None else frame - np.concatenate([low, low])
    unknown = np.zeros((height, width), bool)
    unknown[: max(frame[1], 0)] = True
    unknown[frame[3] + 1 :] = True
    unknown[:, : max(frame[0], 0)] = True
    unknown[:, frame[2] + 1 :] = True
    if not grid.own:
        unknown |= _outside_circle(inverse, origin * focal + low)
    if view is not None:
        unknown |= _outside_lines(inverse, origin + low / focal, focal, view)
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
        inverse,
        unknown,
        focal,
        corner,
        num_points,
        count,
        centre,
        _range_step(used),
        grid.own,
        np.zeros(2, bool) if grid.own else _in_lines(inverse, focal),
        turn,
    )


def _range_step(points: np.ndarray) -> float:
    """Step (m) in which the depths or else the ranges of (3, N) points come; 0 where they do
    not.

    A stereo camera's come in steps of disparity, of inverse depth: that at the median depth, if it
    is the larger one, as depths may have been rounded since.
    """
    some = points[:, :: max(1, points.shape[1] // _STEP_POINTS)]
    unit = quantile(some[2], 0.5) ** 2
    of_disparity = grid_of(1.0 / some[2], None, _DISPARITY_STEPS_M / unit)
    step = 0.0 if of_disparity is None else unit * float(of_disparity[0])
    for values in (some[2], np.linalg.norm(some, axis=0)):
        grid = grid_of(values, None, _SMALLEST_STEP_M)
        if grid is not None:
            return max(step, float(grid[0]))
    return step


def _in_lines(inverse: np.ndarray, focal: float) -> np.ndarray:
    """(2,) bool, whether along the rows and along the columns many returns have the next one of
    their surface beyond empty pixels."""
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


def _likely_frame(inverse: np.ndarray) -> np.ndarray:
    """First column and row, last column and row of the frame, as far as a plain cloud tells.

    Where the returns end in a row or column that holds most of what the next ones farther in hold,
    the target leaves the frame: its own outline seldom runs along the pixels.
    """
    seen = inverse > 0
    height, width = seen.shape
    inner = seen[_MARGIN_PX:-_MARGIN_PX, _MARGIN_PX:-_MARGIN_PX]
    left, right, top, bottom = (
        _cut_off(side) for side in (inner.T, inner.T[::-1], inner, inner[::-1])
    )
    edge = _MARGIN_PX
    return np.array(
        [
            edge if left else 0,
            edge if top else 0,
            width - 1 - edge if right else width - 1,
            height - 1 - edge if bottom else height - 1,
        ]
    )


def _cut_off(seen: np.ndarray) -> bool:
    """Whether what is seen (N, M) leaves the frame across row 0."""
    last = int(np.count_nonzero(seen[0]))
    around = int(np.count_nonzero(seen[:_FRAME_ROWS].any(axis=0)))
    return last >= _FRAME_LEAST and last > _FRAME_SHARE * around


def _outside_lines(
    inverse: np.ndarray, corner: np.ndarray, focal: float, view: np.ndarray
) -> np.ndarray:
    """Pixels (H, W), bool, above or below a lidar's field, as far as the cloud tells.

    What turns about the sensor's z axis scans lines of the same elevation, which are no straight
    lines of the image. Where most of what is seen ends in the highest or the lowest one, which is
    bent, the target leaves the field there.
    """
    height, width = inverse.shape
    outside = np.zeros((height, width), bool)
    if view[2, 2] != 0.0:
        # Straight above or below the sensor.
        return outside
    x = corner[0] + np.arange(width) / focal
    y = corner[1] + np.arange(height)[:, None] / focal
    ray = view[:, 0, None, None] * x + view[:, 1, None, None] * y + view[:, 2, None, None]
    # In pixels across the lines, where these cross the middle of the image.
    level = np.rint(ray[2] / np.hypot(ray[0], ray[1]) * focal)
    seen = inverse > 0
    along = 0 if view[2, 1] != 0.0 else 1
    for side in (level, -level):
        ends = np.where(seen, side, -np.inf).max(axis=along)
        last = ends.max()
        cut = np.flatnonzero(ends >= last - 1.0)
        if len(cut) > _CUT_SHARE * np.count_nonzero(ends > -np.inf):
            # The line itself may lie between two pixels.
            beyond = side >= last - 1.0
            if _bends(np.count_nonzero(beyond, axis=along)[cut], cut):
                outside |= ~seen & beyond
    return outside


def _outside_circle(inverse: np.ndarray, corner_px: np.ndarray) -> np.ndarray:
    """Pixels (H, W), bool, outside a round field about the sensor's forward axis, as a rosette scan
    has it, as far as the cloud tells.

    corner_px : (2,) of pixel (0, 0) from that axis. Where what is seen ends in one circle about the
    axis, over more of it than a straight edge could, the target leaves the field there.
    """
    height, width = inverse.shape
    x = corner_px[0] + np.arange(width)
    y = corner_px[1] + np.arange(height)[:, None]
    radius = np.hypot(x, y)
    row, column = np.nonzero(inverse)
    of_seen = radius[row, column]
    last = of_seen.max()
    outer = of_seen > last - 1.0 - _ROUND_PX
    angle = np.arctan2(y[row[outer], 0], x[column[outer]])
    met = len(np.unique(np.floor(angle * last)))
    if met < _ROUND_SHARE * 2 * np.sqrt(2 * (1.0 + _ROUND_PX) * last):
        return np.zeros((height, width), bool)
    return (inverse == 0) & (radius > last - 1.0 - _ROUND_PX)


def _bends(place: np.ndarray, at: np.ndarray) -> bool:
    """Whether a line's places (N,) lie off a straight one, as a target's edge is, by a pixel."""
    arm = at - at.mean()
    off = place - place.mean() - arm * (arm @ place / max(float(arm @ arm), 1.0))
    return bool(np.ptp(off) > _BENT_PX)


def _speckle(inverse: np.ndarray, focal: float) -> np.ndarray:
    """Returns that fewer than two of the eight neighbours share: outliers and mixed pixels."""
    width = inverse.shape[1]
    # No return is far from every return. The margin keeps rows from running into each other.
    level = np.where(inverse > 0, inverse, np.float32(-1e9)).ravel()
    seen = level > 0
    tolerance = level * np.float32(_STEEPEST / focal) + np.float32(1e-6)
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
