"""The pixels' raster in an edge: blur that came after the light was sampled leaves it there.

A pixel that a limb crosses holds the share p of it, wherever in the pixel the limb runs. Blurred
after that, the edge has the square of its width larger by p (1 - p), and is skew: its blur goes
with the cosine of the limb's phase in the raster, its place with the sine along the normal. By how
much is one number each for a whole frame, and next to nothing where optics alone blur. Across most
limbs phases change fast and their errors average out; along a row or a column they do not.
Source: derived here; the error is odd in p as the raster is its own mirror image.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

# One sigma beforehand of what the raster does at most; blurred by .7 px after sampling: .020, .081.
PLACE_SIGMA_PX, BLUR_SIGMA_PX = 0.015, 0.06
_REST_PX, _BLUR_REST_PX = 0.003, 0.015  # what goes with twice the phase, and is not followed


@dataclass(frozen=True, eq=False)
class Raster:
    """How stretches of limb lie in the raster.

    phase : (N,) complex, means over each stretch of the edge's phase between two rows or columns,
    whichever run rather with it, along its normal; zero for stretches that tell nothing.
    """

    phase: np.ndarray

    @classmethod
    def of(cls, normal_px: np.ndarray, phase: np.ndarray, good: np.ndarray) -> Raster:
        """Of stretches with normals (N, 2); phase : (N,) along the image's axes."""
        x, y = normal_px.T
        along = np.where(np.abs(y) > np.abs(x), y, x) > 0.0
        return cls(np.where(along, phase, phase.conj()) * good)

    @property
    def place(self) -> np.ndarray:
        """What a unit of the raster's error moves each edge by (N,)."""
        return self.phase.imag

    @property
    def blur(self) -> np.ndarray:
        """What a unit of it adds to each edge's blur (N,)."""
        return self.phase.real

    @cached_property
    def size(self) -> np.ndarray:
        """Of the phases (N,): one where a stretch runs with the raster."""
        return np.abs(self.phase)

    def shared2(self, variance: float) -> np.ndarray:
        """Variances (N,) of places by an error of so much for a unit of `place`.

        Where stretches lie alike in the raster they have the same error, and count as one.
        """
        place = self.place
        return np.asarray(variance * np.maximum(place * place.sum(), np.square(place)))

    def rest2(self) -> np.ndarray:
        """Variances (N,) of places that are left when the error is taken out."""
        return _REST_PX**2 * self._alike

    def blur_rest2(self) -> np.ndarray:
        """Variances (N,) of the blur, likewise."""
        return _BLUR_REST_PX**2 * self._alike

    def unshaped(self, step: float) -> np.ndarray:
        """Shares (N,) of the evidence in profiles' shapes that texture leaves, once the raster's is
        taken out. The raster's grows with the step over the profiles' noise.

        step : that ratio.
        """
        return np.asarray(1.0 / (1.0 + np.square(_BLUR_REST_PX * step * self.size)))

    @cached_property
    def _alike(self) -> np.ndarray:
        """Squares of the phases, times the stretches of the same: these count as one."""
        return np.maximum((self.phase.conj() * self.phase.sum()).real, np.square(self.size))
