"""A range image as it would be, had all of its pixels been measured at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.ranges.nearest import nearest
from horizon_sensor_ros.core.target_motion.ranges.pixel_values import depth_in_middles
from horizon_sensor_ros.core.target_motion.ranges.range_image import STEEPEST, RangeImage
from horizon_sensor_ros.core.target_motion.sweeps.velocity import Velocity

_ROUNDS = 3  # until what is looked for in a pixel is found where it was measured
_BORDER_PX = 3  # that stays empty about what is seen


def stilled_image(
    image: RangeImage,
    points: np.ndarray,
    times_s: np.ndarray,
    velocity: Velocity,
    min_points: int = 100,
) -> RangeImage:
    """Bring an image on the sensor's own grid to the stamp of its cloud, on the same grid.

    points (N, 3), times_s (N,) : of the cloud, sensor frame, seconds from the stamp.  min_points :
    TOO_FEW_POINTS where fewer stay in the field.
    Each pixel shows the nearest of what has moved into it; where surfaces have spread, and left it
    empty, what has moved next to it. Where nothing was measured that may have moved there is none,
    so that ends of surfaces stay what they are; what something else hid is not known.
    """
    seen, moved_m = _moved(image, points, times_s, velocity)
    shift, stays = _shifts(image, seen, moved_m)
    seen[seen], moved_m = stays, moved_m[:, stays]
    if np.count_nonzero(stays) < min_points:
        reason = f"{np.count_nonzero(stays)} of {len(stays)} returns were in the field at the stamp"
        return replace(image, status=Status.TOO_FEW_POINTS, reason=reason)
    room = int(np.ceil(np.abs(shift).max(initial=0.0))) + _BORDER_PX
    shift = np.pad(shift, ((0, 0), (room, room), (room, room)))
    seen, unknown = np.pad(seen, room), np.pad(image.unknown, room, mode="edge")
    # What moves past an empty pixel moves as the nearest surface does.
    source, off_px = _sources(shift.reshape(2, -1)[:, nearest(seen)[1]])
    there = np.stack(np.nonzero(seen)[::-1]) + shift[:, seen]
    pixel = np.rint(there).astype(np.int64)
    index = pixel[1] * seen.shape[1] + pixel[0]
    inverse = np.zeros(seen.shape)
    inverse[seen] = 1.0 / moved_m[2]
    spread = seen[source]
    spread.ravel()[index] = False
    beside = (np.abs(off_px) < 1.0).all(axis=0)
    unknown = unknown[source] | (spread & ~beside)
    spread &= beside
    place = np.flatnonzero(spread)
    levels = depth_in_middles(
        np.concatenate([1.0 / moved_m[2], inverse[source][spread]]),
        np.concatenate([index, place]),
        np.concatenate([there - pixel, off_px[:, spread]], axis=1),
        seen.shape,
        STEEPEST / image.focal_px,
    )
    mixed = np.pad(image.mixed, room)[source]
    return replace(
        image,
        inverse_depth=levels,
        unknown=unknown & (levels == 0),
        mixed=mixed & (levels == 0),
        origin=image.origin - room / image.focal_px,
        num_used=int(np.count_nonzero(levels)),
        centroid_m=moved_m.mean(axis=1),
    )


def _moved(
    image: RangeImage, points: np.ndarray, times_s: np.ndarray, velocity: Velocity
) -> tuple[np.ndarray, np.ndarray]:
    """Which pixels (H, W) have a return of a known time; and where those were at the stamp, (3, N)
    in the view frame.
    """
    which, index, _ = image.project(points)
    times = np.full(image.inverse_depth.shape, np.nan)
    times.ravel()[index] = times_s[which]
    seen = (image.inverse_depth > 0) & np.isfinite(times)
    tan_x, tan_y = image.tangents()
    place = np.nonzero(seen)
    depth = 1.0 / image.inverse_depth[seen].astype(np.float64)
    rays = np.stack([tan_x[place[1]], tan_y[place[0]], np.ones(len(depth))], axis=1)
    turn = image.rot_sensor_from_view
    back = velocity.moved((rays * depth[:, None]) @ turn.T + image.sensor_m, -times[seen])
    return seen, ((back - image.sensor_m) @ turn).T


def _shifts(
    image: RangeImage, seen: np.ndarray, moved_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """By how many pixels (2, H, W) right and down those that are seen move, 0 elsewhere; and which
    of them (N,) stay in the field, or near it.
    """
    tan_x, tan_y = image.tangents()
    row, column = np.nonzero(seen)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        to = moved_m[:2] / moved_m[2]
        shift = (to - np.stack([tan_x[column], tan_y[row]])) * image.focal_px
        stays = (moved_m[2] > 0.0) & (np.abs(shift) < max(seen.shape)).all(axis=0)
    every = np.zeros((2, *seen.shape))
    every[:, row[stays], column[stays]] = shift[:, stays]
    return every, stays


def _sources(shift: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """For each pixel the one (row, column) that a shift (2, H, W) right and down brings nearest to
    it; and by how much that misses it, (2, H, W).
    """
    height, width = shift.shape[1:]
    row, column = np.indices((height, width))
    source = row, column
    for _ in range(_ROUNDS):
        right, down = shift[:, source[0], source[1]]
        source = (
            np.clip(np.rint(row - down).astype(np.int64), 0, height - 1),
            np.clip(np.rint(column - right).astype(np.int64), 0, width - 1),
        )
    right, down = shift[:, source[0], source[1]]
    return source, np.stack([source[1] + right - column, source[0] + down - row])
