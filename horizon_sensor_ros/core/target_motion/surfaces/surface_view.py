"""All that one view shows of the target's surface: planes, surface elements, edges, thin parts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from horizon_sensor_ros.core.target_motion.noise.common_noise import LineMeans, line_means
from horizon_sensor_ros.core.target_motion.ranges.nearest import nearest
from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage
from horizon_sensor_ros.core.target_motion.surfaces.edges.detection import find_edges
from horizon_sensor_ros.core.target_motion.surfaces.edges.edges import Edges
from horizon_sensor_ros.core.target_motion.surfaces.parts import Parts, find_parts
from horizon_sensor_ros.core.target_motion.surfaces.planes import local_planes, normal_noise
from horizon_sensor_ros.core.target_motion.surfaces.surfels import Surfels, find_surfels

# What a plane borrowed from the next window may lean by on a curved surface, alike in both views.
_BORROWED_TILT_RAD = 0.08
# A gap amid the target is so wide at most, rms radii of it. Closing wider ones than this would take
# long.
_GAP, _MOST_REACH_PX = 1.0, 40


@dataclass(frozen=True, eq=False)
class SurfaceView:
    """All that the registration needs of one cloud; lengths in metres, in the view frame.

    sigma_m, slant_growth : range noise, see `Planes`.  footprint_m : a pixel's width at the target.
        size_m : the target's rms radius.
    point_map, normal_map : (H W, 3) point and normal (towards the sensor) of the local plane at
        each pixel; without a plane the return itself, and 0.
    plane : (H W) bool, where there is one.  steady : (H W) bool, where it may be paired: not at the
        limb of a curved body.  tilt_rad : (H W) of its normal, see Surfels;
        normal_noise_rad : of all.  noise_m : (H W) float32, along the normal, of one measurement.
    radius_px : of the planes' windows.
    surfels, edges, parts : what is registered.
    depth_map : (H W) depth of the return, 0 where there is none.
    gap_px : (H W) distance to the nearest return or unknown pixel.
    """

    image: RangeImage
    sigma_m: float
    slant_growth: float
    footprint_m: float
    size_m: float
    point_map: np.ndarray
    normal_map: np.ndarray
    plane: np.ndarray
    steady: np.ndarray
    tilt_rad: np.ndarray
    normal_noise_rad: float
    noise_m: np.ndarray
    radius_px: int
    depth_map: np.ndarray
    gap_px: np.ndarray
    surfels: Surfels
    edges: Edges
    parts: Parts

    @cached_property
    def nearest(self) -> np.ndarray:
        """(H W) index of the nearest pixel with a plane; only a search asks for it."""
        return nearest(self.plane.reshape(self.image.inverse_depth.shape))[1].ravel()

    @cached_property
    def closest_around(self) -> np.ndarray:
        """(H W) depth of the closest return in a pixel and those around it; infinite without."""
        highest = cv2.dilate(self.image.inverse_depth, np.ones((3, 3), np.uint8)).ravel()
        closest = np.full(highest.shape, np.inf, np.float32)
        return np.divide(np.float32(1.0), highest, out=closest, where=highest > 0)

    @cached_property
    def gaps(self) -> np.ndarray:
        """(H W) bool, pixels without a return that lie between returns, in gaps narrower than the
        target's rms radius; only a doubt asks for it.
        """
        reach = min(max(1, round(_GAP / 2 * self.size_m / self.footprint_m)), _MOST_REACH_PX)
        seen = np.pad((self.image.inverse_depth > 0).view(np.uint8), reach)
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
        closed = cv2.morphologyEx(seen, cv2.MORPH_CLOSE, disc)
        return (closed > seen)[reach:-reach, reach:-reach].ravel()

    @cached_property
    def line_means(self) -> tuple[LineMeans, LineMeans]:
        """What its rows and its columns tell of noise that they have in common."""
        return line_means(self.image, self.sigma_m)

    @property
    def coplanar(self) -> bool:
        """Whether nearly all returns lie on one plane, within noise."""
        points = self.sample(1000)[0].astype(float)
        # Of returns on one line the plane is arbitrary, and some of all planes leave noise outside.
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1]
        if spread / np.sqrt(len(points)) < self.footprint_m + 4 * self.sigma_m:
            return True
        close = np.ones(len(points), bool)
        for _ in range(3):
            centre = points[close].mean(axis=0)
            normal = np.linalg.svd(points[close] - centre, full_matrices=False)[2][2]
            off = np.abs((points - centre) @ normal)
            # The better half decides, so that speckle and a few odd returns do not tilt the plane.
            close = off <= np.median(off)
        return bool(np.mean(off < 4 * self.sigma_m + 0.1 * self.footprint_m) > 0.97)

    def sample(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Points and normals (up to about ``count``, 3) float32 spread evenly over all returns; no
        plane: normal 0.
        """
        seen = np.flatnonzero(self.depth_map)
        index = seen[:: max(1, round(len(seen) / count))]
        return self.point_map.take(index, axis=0), self.normal_map.take(index, axis=0)


def surface_view(image: RangeImage, sigma_m: float | None = None) -> SurfaceView:
    """Fit planes and edges to a range image whose status is OK.

    sigma_m : range noise; None: estimated from the image.
    """
    planes = local_planes(image, sigma_m)
    inverse = image.inverse_depth
    tilt = np.float32(_BORROWED_TILT_RAD) * ~planes.own.ravel()
    noise = np.zeros(inverse.size, np.float32)
    index = np.flatnonzero(planes.found)
    cosine = planes.cosine.ravel()[index]
    noise[index] = normal_noise(
        planes.sigma_m, planes.slant_growth, planes.footprint_m, cosine, tilt[index],
        planes.off_px[index],
    )  # fmt: skip
    seen = np.flatnonzero(inverse)
    arm = planes.points.take(seen, axis=0) - image.centroid_m.astype(np.float32)
    mean = np.ones(len(seen), np.float32) @ arm / len(seen)
    size = np.sqrt(np.vdot(arm, arm) / len(seen) - mean @ mean)
    depth_map = np.zeros(inverse.size, np.float32)
    depth_map[seen] = 1 / inverse.ravel()[seen]
    hidden = ((inverse == 0) & ~image.unknown).view(np.uint8)
    return SurfaceView(
        image, planes.sigma_m, planes.slant_growth, planes.footprint_m, float(size),
        planes.points, planes.normals, planes.found.ravel(),
        (planes.found & ~planes.limb).ravel(), tilt, planes.normal_noise_rad, noise,
        planes.radius_px, depth_map,
        cv2.distanceTransform(hidden, cv2.DIST_L2, 3).ravel(),
        find_surfels(image, planes, tilt, noise), find_edges(image, planes),
        find_parts(image, planes),
    )  # fmt: skip
