"""Kriged places of a sharp edge in a sample of the limb, about a limb that is known to a tenth of a
pixel or so.
"""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.points import SharedError
from horizon_sensor_ros.core.limb.profiles import EdgePlaces
from horizon_sensor_ros.core.limb.sample import LimbSample
from horizon_sensor_ros.core.limb.texture.kriging import KrigedEdges, Stretches, krige_edges

# Off the predicted place: edges are placed one by one, and kriged about the limb that fits those.
# Kriging about what it found itself would follow the texture further and further.
_OFF_PX = 0.1
_FAR_PX = 1.0  # from the limb about which it is done: no place of its edge


class KrigedLimb:
    """A sample's edges of one look, as `krige_edges` measures them.

    base : (M, 3) how they move with the limb's three unknowns.
    """

    def __init__(self, sample: LimbSample, look: EdgeLook, rho_rad: float) -> None:
        self._sample = sample
        self._look = look
        self._rho_rad = rho_rad
        self._stretches = sample.stretches(look.psf_px, rho_rad)
        self.base = self._stretches.base

    def about_prediction(self, good: np.ndarray) -> tuple[EdgePlaces | None, SharedError]:
        """Places of the edges about the predicted limb, and their shared error; None where the limb
        lies too far from it.

        good : (M,) profiles that show an edge; the others come back as at the border.
        """
        found, shift = self._kriged(self._sample, self._stretches, good)
        if np.abs(self.base @ found.limb).max() > _OFF_PX:
            return None, found.shared
        return _places(found, shift, self._stretches, good), found.shared

    def about(self, limb: np.ndarray, good: np.ndarray) -> tuple[EdgePlaces, SharedError]:
        """The same about a limb that is moved from the predicted one by (3,), wherever it lies."""
        sample = self._sample.moved(limb)
        stretches = sample.stretches(self._look.psf_px, self._rho_rad)
        found, shift = self._kriged(sample, stretches, good)
        return _places(found, shift + self.base @ limb, stretches, good), found.shared

    @staticmethod
    def _kriged(
        sample: LimbSample, stretches: Stretches, good: np.ndarray
    ) -> tuple[KrigedEdges, np.ndarray]:
        """What kriging finds, and by how much (M,) the samples' rounding shifted it."""
        phase = sample.phase()
        return krige_edges(stretches, good, phase[:, 1] + 1j * phase[:, 2]), phase[:, 0]


def _places(
    found: KrigedEdges, shift_px: np.ndarray, stretches: Stretches, good: np.ndarray
) -> EdgePlaces:
    return EdgePlaces(
        found.offset_px + shift_px,
        found.sigma_px,
        found.step,
        found.step / stretches.noise,
        found.misfit,
        ~good | (np.abs(found.offset_px) > _FAR_PX),
    )
