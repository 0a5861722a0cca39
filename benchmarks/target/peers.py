"""Other people's registration, for comparison; each returns pose_b_from_a (4, 4) from two (N, 3)
clouds.

They start where a user without a guess would start them: no turn, centroid on centroid. A peer
that cannot be imported is left out of PEERS; MISSING says which and why.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

PEERS: dict[str, Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]] = {}
MISSING: dict[str, str] = {}

RADII_M = (0.4, 0.15, 0.06)


def centroid_start(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """No turn, centroid on centroid."""
    start = np.eye(4)
    start[:3, 3] = b.mean(axis=0) - a.mean(axis=0)
    return start


try:
    import small_gicp
except ImportError as error:
    MISSING["small_gicp"] = str(error)
else:

    def vgicp(a: np.ndarray, b: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Voxelised GICP at a coarse and a fine voxel size."""
        cloud_a, _ = small_gicp.preprocess_points(a, 0.03, num_neighbors=10, num_threads=1)
        cloud_b, _ = small_gicp.preprocess_points(b, 0.03, num_neighbors=10, num_threads=1)
        pose = start
        for voxel in (0.3, 0.1):
            voxels = small_gicp.GaussianVoxelMap(voxel)
            voxels.insert(cloud_b)
            result = small_gicp.align(
                voxels, cloud_a, pose, max_correspondence_distance=1.0, num_threads=1,
                max_iterations=30, rotation_epsilon=1e-4, translation_epsilon=1e-4,
            )  # fmt: skip
            pose = result.T_target_source
        return pose

    def gicp(a: np.ndarray, b: np.ndarray, start: np.ndarray) -> np.ndarray:
        """GICP at three shrinking radii."""
        cloud_a, _ = small_gicp.preprocess_points(a, 0.02, num_neighbors=15, num_threads=1)
        cloud_b, tree = small_gicp.preprocess_points(b, 0.02, num_neighbors=15, num_threads=1)
        pose = start
        for radius in RADII_M:
            result = small_gicp.align(
                cloud_b, cloud_a, tree, pose, "GICP", radius, 1, 30, 1e-4, 1e-4
            )
            pose = result.T_target_source
        return pose

    PEERS["small_gicp VGICP"] = vgicp
    PEERS["small_gicp GICP"] = gicp

try:
    import open3d
except ImportError as error:
    MISSING["open3d"] = str(error)
else:

    def open3d_gicp(a: np.ndarray, b: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Open3D's generalised ICP at three shrinking radii."""
        registration = open3d.pipelines.registration
        clouds = []
        for points in (a, b):
            cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
            cloud = cloud.voxel_down_sample(0.02)
            cloud.estimate_covariances(open3d.geometry.KDTreeSearchParamKNN(15))
            clouds.append(cloud)
        pose = start
        for radius in RADII_M:
            result = registration.registration_generalized_icp(
                clouds[0], clouds[1], radius, pose,
                registration.TransformationEstimationForGeneralizedICP(),
                registration.ICPConvergenceCriteria(max_iteration=30),
            )  # fmt: skip
            pose = result.transformation
        return np.asarray(pose)

    PEERS["Open3D GICP"] = open3d_gicp
