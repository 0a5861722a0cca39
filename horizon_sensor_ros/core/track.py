"""Where the limb will be in the next frames, from where it was: what spares them the search."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from horizon_sensor_ros.core.camera_view import CameraView
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.limb.detection import Detection, LimbState
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage


@dataclass(frozen=True, eq=False)
class Track:
    """The limb of the last set of frames, and what it looked like.

    views : of that set. cameras : names of those whose limbs lie on one cone. nadir_base,
    rho_rad : its disc's cone. outside : of the other cameras, by name, how many edges agreed on one
    disc, a limb or not, when they were searched. last_cone : nadir and rho of the set before, None
    right after a search.
    state : what the limb looked like. working : the search's images of the frames, one per frame.
    layer_rad : height of airglow above the limb. airglow : whether it shows. age : sets since the
    search.
    """

    views: tuple[CameraView, ...]
    cameras: tuple[str, ...]
    nadir_base: np.ndarray
    rho_rad: float
    state: LimbState
    working: tuple[WorkingImage, ...]
    layer_rad: float
    airglow: bool
    outside: Mapping[str, int]
    last_cone: tuple[np.ndarray, float] | None = None
    age: int = 0

    @classmethod
    def started(
        cls,
        views: Sequence[CameraView],
        detection: Detection,
        fit: HorizonFit,
        cameras: tuple[str, ...],
        outside: Mapping[str, int],
    ) -> Track:
        """Track from a fit, with its disc, of what a search found. cameras, outside : as of the
        track.
        """
        assert fit.disc is not None
        disc = fit.disc
        return cls(
            views=tuple(views),
            cameras=cameras,
            nadir_base=disc.nadir,
            rho_rad=disc.rho_rad,
            state=detection.state,
            working=detection.working,
            layer_rad=detection.layer_rad,
            airglow=detection.airglow,
            outside=outside,
        )

    def continued(self, detection: Detection, fit: HorizonFit) -> Track:
        """Track with one more fit, with its disc."""
        assert fit.disc is not None
        return replace(
            self,
            nadir_base=fit.disc.nadir,
            rho_rad=fit.disc.rho_rad,
            last_cone=(self.nadir_base, self.rho_rad),
            state=replace(self.state, looks=detection.looks, steepness=detection.steepness),
            age=self.age + 1,
        )

    def is_of(self, views: Sequence[CameraView]) -> bool:
        """Whether frames come from the very cameras of the track, calibrations included."""
        return len(views) == len(self.views) and all(
            new is old for new, old in zip(views, self.views, strict=True)
        )

    def predicted_cone(self, rot_now_from_last: np.ndarray | None) -> tuple[np.ndarray, float]:
        """Nadir (3,) and rho expected now: turned as the gyro says, or moved as in the last step.

        rot_now_from_last : (3, 3), see `Aiding`. Without it sets are taken to come evenly.
        """
        if rot_now_from_last is not None:
            return rot_now_from_last @ self.nadir_base, self.rho_rad
        if self.last_cone is None:
            return self.nadir_base, self.rho_rad
        nadir, rho = self.last_cone
        # The errors of nadir and rho hang together so that the limb in the frame is known far
        # better than either: moved on together they stay so.
        ahead = 2.0 * (self.nadir_base @ nadir) * self.nadir_base - nadir
        return ahead, 2.0 * self.rho_rad - rho
