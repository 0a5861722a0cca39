"""How far a curved surface leads the planes that are fitted to it."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.target_motion.surfaces.windows import PlaneFit, box

# Squared ratio of the mean sag of windows to its noise, beyond which a surface counts as curved:
# carried on to the pixels beside it its planes would lie off it, and those of windows cut off by
# its limb lie off it and lean, in both views alike. Three standard deviations where the noise is
# twice as large, as at a slant.
_CURVED = 36.0


def sag_of_windows(
    fit: PlaneFit, flat: np.ndarray, sigma_m: np.ndarray | np.float32, radius: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """By how much a curved surface leads the planes fitted to it, where it bends, and where it is
    curved: bends alike from window to window.

    flat : (H, W) bool, windows that hold one plane. sigma_m : of single returns, for all or (H, W).
    radius : of the windows, px. Returns by how much the surface's inverse depth (H, W), 1/m, is
    above the planes', and both masks (H, W).

    The plane of a window passes behind the middle of a dome, the farther the more slanted the dome
    is seen: two views of it would differ, all over the surface alike. What a fit of second degree
    adds in the middle of full windows is noise one by one, so they are averaged over a
    neighbourhood; not where it differs from window to window, as about an edge.
    """
    side = 2 * radius + 1
    one = np.ones(side, np.float32)
    square = np.arange(-radius, radius + 1, dtype=np.float32) ** 2
    bump = square - square.mean()
    gain = -square.mean() / (side * float(bump @ bump))
    full = (flat & (fit.count > side * side - 0.5)).astype(np.float32)
    lead = full * gain * (box(fit.about_middle, bump, one) + box(fit.about_middle, one, bump))
    noise = np.float32(abs(gain) * np.sqrt(2 * side * float(bump @ bump))) * sigma_m * fit.level**2
    count = box(full, one, one)
    some = np.maximum(count, 1)
    mean = box(lead, one, one) / some
    square_m, square_n = mean * mean, noise * noise
    enough = count > 0.5 * side * side
    alike = box(lead * lead, one, one) / some - square_m < 4 * square_n + 0.25 * square_m
    # On the surface's border a window may have neighbours on another one only.
    alike &= (full == 0) | (np.abs(lead - mean) < 4 * noise + 0.5 * np.abs(mean))
    # The mean of windows that overlap, over as many about them, is as much surer.
    sums = [np.convolve(each, one / side) for each in (bump, one)]
    surer = np.float32(bump @ bump * side / np.prod([each @ each for each in sums]))
    share = count / (side * side)
    bends = square_m * (1 + (surer - 1) * share * share) > _CURVED * square_n
    bends &= share > 0.15
    return np.where(enough & alike & flat, mean, np.float32(0)), bends, bends & alike
