"""What lies below the limb, as a blurred profile across it sees it."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.mathematics.normal_law import normal_density

_NODES = 40  # in the root of the depth


def seen_depths(x_px: np.ndarray, psf_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Roots (M,) of depths below the limb, and by how much a profile sees each (J, M).

    x_px : (J,) distances outside the limb, ascending; psf_px : the blur, one sigma. The distance
    along the ground, and the air in front of it, go with the root: even steps in that.
    """
    spacing = np.sqrt(4.0 * psf_px - x_px[0]) / _NODES
    root = (np.arange(_NODES) + 0.5) * spacing
    beyond = (x_px[:, None] + root * root) / psf_px
    return root, normal_density(beyond) / psf_px * (2.0 * spacing * root)


def seen_slopes(
    x_px: np.ndarray, psf_px: float, root: np.ndarray, blur: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (J, M) of what a profile sees of each depth, by x_px and by psf_px.

    root, blur : as of `seen_depths`, whose steps are kept.
    """
    beyond = (x_px[:, None] + root * root) / psf_px
    return blur * (beyond / -psf_px), blur * ((beyond * beyond - 1.0) / psf_px)
