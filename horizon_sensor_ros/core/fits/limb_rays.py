"""Limb points of all cameras as rays in the base frame, with the cone's residuals in pixels."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis

# A limb normal so far off the cone's that a distance along it says nothing about the cone.
_LEAST_NORMAL_COSINE = 0.2


@dataclass(frozen=True, eq=False)
class LimbRays:
    """Usable limb points of one or more cameras.

    rays_base : (N, 3) unit. outward_base : (N, 3) step of the ray, towards space and straight away
    from the limb, that moves its image one pixel along the limb normal; radians per pixel.
    sigma_px : (N,) along that normal. camera : (N,) index into cameras, the names. num_points :
    before unusable ones (not finite, or without a ray) were dropped. ordered : the points are known
    to come camera by camera, and along the limb. step : (N,) as of `LimbPoints`, of one camera;
    else empty.
    """

    rays_base: np.ndarray
    outward_base: np.ndarray
    sigma_px: np.ndarray
    camera: np.ndarray
    cameras: tuple[str, ...]
    num_points: int
    ordered: bool = False
    step: np.ndarray = field(default_factory=lambda: np.empty(0))

    def __len__(self) -> int:
        return len(self.rays_base)

    def take(self, which: np.ndarray) -> LimbRays:
        """Some of them, by number (M,)."""
        return LimbRays(
            self.rays_base[which],
            self.outward_base[which],
            self.sigma_px[which],
            self.camera[which],
            self.cameras,
            len(which),
        )

    @cached_property
    def sigma_rad(self) -> np.ndarray:
        """(N,) one sigma of the angle between ray and limb."""
        return self.sigma_px * np.sqrt(np.einsum("ij,ij->i", self.outward_base, self.outward_base))

    @cached_property
    def least_growth(self) -> np.ndarray:
        """(N,) rad per pixel below which a distance along the normal means nothing."""
        return _LEAST_NORMAL_COSINE * self.sigma_rad / self.sigma_px

    @cached_property
    def log_scale(self) -> np.ndarray:
        """(N,) logarithm of the pixels to a radian across the limb."""
        return np.asarray(np.log(self.sigma_px / self.sigma_rad))

    def angles(self, nadir_base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rays' angles from nadir (N,), rad, and their growth per pixel (N,).

        The growth is along each point's normal, rad per pixel: positive where the normal points
        away from the planet, as it should.
        """
        cosine = np.minimum(np.maximum(self.rays_base @ nadir_base, -1.0), 1.0)
        sine = np.sqrt(np.maximum(1.0 - cosine * cosine, 1e-300))
        return np.arccos(cosine), (self.outward_base @ nadir_base) / -sine

    def points_to_space(self, direction_base: np.ndarray) -> bool:
        """Whether most of the limb normals have a component along a direction (3,): if it is a
        cone's axis, the planet lies on the other side.
        """
        outwards = int(np.count_nonzero(self.outward_base @ direction_base > 0))
        return outwards > 0.5 * len(self)

    def residuals_px(self, nadir_base: np.ndarray, rho_rad: float) -> np.ndarray:
        """Return each point's distance (N,) from the cone along its normal, px.

        Positive: the point lies outside the predicted disc. To first order in the distance, with
        the camera's exact scale at the point. Infinite where the normal lies across the cone's, or
        against it.
        """
        return self.residuals_and_growth(nadir_base, rho_rad)[0]

    def residuals_and_growth(
        self, nadir_base: np.ndarray, rho_rad: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """`residuals_px` (N,), and the angles' growth per pixel (N,) as `angles` has it."""
        theta, growth = self.angles(nadir_base)
        distance = np.full(len(self), np.inf)
        np.divide(theta - rho_rad, growth, out=distance, where=growth > self.least_growth)
        return distance, growth

    def design(self, nadir_base: np.ndarray, basis: np.ndarray) -> np.ndarray:
        """Derivative (N, 3) of ``angle - rho`` by nadir's two tangent components and rho.

        basis : (3, 2) tangent vectors at nadir, see `tangent_basis`.
        """
        cosine = self.rays_base @ nadir_base
        out = np.empty((len(self), 3))
        np.matmul(self.rays_base, -basis, out=out[:, :2])
        out[:, :2] /= np.sqrt(np.maximum(1.0 - cosine * cosine, 1e-300))[:, None]
        out[:, 2] = -1.0
        return out

    def growth(self, nadir_base: np.ndarray) -> np.ndarray:
        """Growth (N,) of the angles as `angles` has it; infinite where a distance along the normal
        means nothing.
        """
        growth = self.angles(nadir_base)[1]
        return np.where(growth > self.least_growth, growth, np.inf)

    def design_sigmas(self, nadir_base: np.ndarray, basis: np.ndarray) -> np.ndarray:
        """`design` (N, 3) of residuals over their sigmas."""
        per_sigma = self.growth(nadir_base) * self.sigma_px
        return self.design(nadir_base, basis) / per_sigma[:, None]

    def along_limb(self, nadir_base: np.ndarray) -> np.ndarray:
        """Order (N,) of the points: camera by camera, then along the limb."""
        if self.ordered:
            return np.arange(len(self))
        across = self.rays_base @ tangent_basis(nadir_base)
        # Measured from the mean direction, so that the cut at +-pi falls into a gap if there is
        # one.
        x, y = across.sum(axis=0).tolist()
        turned = across @ np.array([[x, -y], [y, x]])
        azimuth = np.arctan2(turned[:, 1], turned[:, 0])
        return np.lexsort((azimuth, self.camera))


def no_rays(num_points: int) -> LimbRays:
    """Return the rays of points of which none is usable."""
    none = np.empty((0, 3))
    return LimbRays(none, none, np.empty(0), np.empty(0, dtype=int), (), num_points)


def rays_of(view: CameraView, limb: LimbPoints) -> LimbRays:
    """Bring the limb points of one camera into the base frame."""
    px = np.asarray(limb.px, dtype=float)
    rays = view.camera.rays(px)
    normal = np.asarray(limb.normal_px, dtype=float)
    sigma = np.asarray(limb.sigma_px, dtype=float)
    keep = np.isfinite(rays[:, 0] + normal[:, 0] + normal[:, 1]) & (sigma > 0) & (sigma < 1e6)
    keep &= normal.any(axis=1)
    step = limb.step
    if not keep.all():
        rays, normal, sigma = rays[keep], normal[keep], sigma[keep]
        step = step[keep] if len(step) else step
    if len(rays) == 0:
        return no_rays(len(px))
    outward = _per_px(view.camera.pixel_gradients(rays, normal))
    rot = view.rot_base_from_cam.T
    index = np.zeros(len(rays), dtype=int)
    ordered = limb.predicted is not None
    cameras = (view.name,)
    return LimbRays(rays @ rot, outward @ rot, sigma, index, cameras, len(px), ordered, step)


def outward_per_px(jacobian: np.ndarray, normal_px: np.ndarray) -> np.ndarray:
    """Step (N, 3) of a ray straight away from the limb whose image moves one pixel across it.

    jacobian : (N, 2, 3) of pixel by ray. normal_px : (N, 2) unit normals of the limb's image. The
    limb's direction in the image has no component along the normal, so ``J^T normal`` is
    perpendicular to the limb among the rays, pixels per radian.
    """
    return _per_px(np.einsum("ijk,ij->ik", jacobian, normal_px))


def _per_px(gradient: np.ndarray) -> np.ndarray:
    """`outward_per_px` of pixels that move so fast (N, 3) across the limb's image."""
    return gradient / np.einsum("ij,ij->i", gradient, gradient)[:, None]
