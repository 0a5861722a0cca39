"""Kriged places of a sharp edge in a sample of the limb, about a limb that is known to a tenth of a
pixel or so.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.profiles import EdgePlaces, scatter_px
from horizon_sensor_ros.core.limb.sample import LimbSample
from horizon_sensor_ros.core.limb.texture.kriging import KrigedEdges, krige_edges
from horizon_sensor_ros.core.limb.texture.stretches import Stretches
from horizon_sensor_ros.core.limb_points import CornerBlur, SharedError
from horizon_sensor_ros.core.mathematics.robust import median

# So sharp an edge shows itself otherwise wherever it falls in the pixels, which kriging takes for
# texture; beside ground as even as this there is none to take out.
_FINE_PSF_PX, _EVEN = 0.6, 0.006
# Off the predicted place: edges are placed one by one, and kriged about the limb that fits those.
# Kriging about what it found itself would follow the texture further and further; but once, and for
# a limb that was followed and is not far off, it is as good.
_OFF_PX, _NEARBY_PX = 0.1, 0.35
# Places are found too near: from as many pixels off by as large a share of that, which grows no
# further from here on, as measured beside truth.
_SHORT = 0.3
_FAR_PX = 1.0  # from the limb about which it is done: no place of its edge


def to_be_kriged(look: EdgeLook, step: np.ndarray) -> bool:
    """Whether kriging is for a sharp edge with such steps (N,) along it."""
    return look.psf_px >= _FINE_PSF_PX or _unevenness(step) > _EVEN


def _unevenness(step: np.ndarray) -> float:
    """One robust sigma of steps (N,) from one profile to the next, over the step."""
    return scatter_px(step) / median(step)


class KrigedPlaces(NamedTuple):
    """Places of edges, their shared error, and corner_blur as of `LimbPoints`; all in pixels of the
    image that was sampled.
    """

    places: EdgePlaces
    shared: SharedError
    corner_blur: CornerBlur | None


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

    def about_prediction(self, good: np.ndarray, *, followed: bool = False) -> KrigedPlaces | None:
        """The edges about the predicted limb; None where the limb lies too far from it.

        good : (M,) profiles that show an edge; the others come back as at the border. followed :
        about the limb that is found, if it lies a little off the prediction.
        """
        found, places = self._kriged(self._sample, self._stretches, good)
        off_px = self._off_px(found)
        if followed and _OFF_PX < off_px < _NEARBY_PX:
            found, places = self._kriged_about(found.limb, good)
            # From farther off than that, places are found too near.
            off_px = self._off_px(found)
        if off_px > _OFF_PX:
            return None
        return KrigedPlaces(places, found.shared, found.corner_blur)

    def about(self, limb: np.ndarray, good: np.ndarray, odd: np.ndarray) -> KrigedPlaces:
        """The edges about a limb that is moved from the predicted one by (3,), as `Stretches.base`
        has it, wherever it lies.

        good : (M,) as of `about_prediction`. odd : (M,) as of `krige_edges`.
        """
        found, places = self._kriged_about(limb, good, odd)
        off_px = self._off_px(found)
        shared = found.shared.besides(SharedError(min(off_px, _SHORT) * off_px, 0.0))
        return KrigedPlaces(places, shared, found.corner_blur)

    def _off_px(self, found: KrigedEdges) -> float:
        """How far the limb that is found lies from that about which it was sought, at most."""
        return float(np.abs(self.base @ found.limb).max())

    def _kriged_about(
        self, limb: np.ndarray, good: np.ndarray, odd: np.ndarray | None = None
    ) -> tuple[KrigedEdges, EdgePlaces]:
        sample = self._sample.moved(limb)
        stretches = sample.stretches(self._look.psf_px, self._rho_rad)
        found, places = self._kriged(sample, stretches, good, odd)
        return found, replace(places, offset_px=places.offset_px + self.base @ limb)

    @staticmethod
    def _kriged(
        sample: LimbSample,
        stretches: Stretches,
        good: np.ndarray,
        odd: np.ndarray | None = None,
    ) -> tuple[KrigedEdges, EdgePlaces]:
        """What kriging finds, and where that is, for all that the samples' rounding shifted it."""
        phase = sample.phase()
        found = krige_edges(stretches, good, phase[:, 1] + 1j * phase[:, 2], odd)
        return found, EdgePlaces(
            found.offset_px + phase[:, 0],
            found.sigma_px,
            found.step,
            found.step / stretches.noise,
            found.misfit,
            ~good | (np.abs(found.offset_px) > _FAR_PX),
        )
