"""The limb of a curved body: where its surface turns away, and planes are not to be trusted."""

from __future__ import annotations

import numpy as np

# Where a surface turns edge-on at less than this cosine, and within two windows bends towards the
# sensor by an angle with a cosine between these, that is the limb of a curved body; what bends more
# is another face.
LIMB_COSINE = 0.5
LIMB_BEND = np.cos(np.radians([10.0, 55.0]))


def limb_reach_px(radius_px: int) -> int:
    """So far within its end the bend of a surface is looked for: there the windows share no return
    with those at the end.
    """
    return 2 * radius_px + 1


def at_limb(
    place: np.ndarray,
    slope_u: np.ndarray,
    slope_v: np.ndarray,
    cosine: np.ndarray,
    normals: np.ndarray,
    reach_px: int,
    width: int,
) -> np.ndarray:
    """Which of the flat indices ``place`` (P,) show the limb of a curved body.

    The window of a pixel there is cut off by the limb, so that its plane is that of the surface
    farther in and leans towards the sensor: by 3 to 10 deg, in both views alike, however the body
    has turned. What tells it from a slanted face is the surface farther in, along the steepest
    slope, which has turned on towards the sensor.
    """
    steepest = np.array([slope_u[place], slope_v[place]])
    steepest *= reach_px / np.maximum(np.sqrt((steepest * steepest).sum(axis=0)), 1e-12)
    du, dv = np.rint(steepest).astype(np.int64)
    inwards = np.clip(place + dv * width + du, 0, len(cosine) - 1)
    bend = np.einsum("ij,ij->i", normals[place], normals[inwards])
    return (cosine[inwards] > cosine[place]) & (LIMB_BEND[1] < bend) & (bend < LIMB_BEND[0])
