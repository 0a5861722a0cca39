"""Where the limb will be in the next frames, from where it was: what spares them the search."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.limb.detection import Detection, LimbState
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage
from horizon_sensor_ros.core.mathematics.attitude import angle_rad

# Steps from which the limb is not moved on farther than so many times, and the least one that has a
# direction.
_FARTHEST, _LEAST_STEP_RAD = 3.0, 1e-9


class ConeStep(NamedTuple):
    """How the limb's cone came to where it is.

    nadir_base (3,), rho_rad : in the set before. since_s : from that set on; None: not known.
    """

    nadir_base: np.ndarray
    rho_rad: float
    since_s: float | None


@dataclass(frozen=True, eq=False)
class Track:
    """The limb of the last set of frames, and what it looked like.

    views : of the frames that were searched.
    cameras : names of those whose limbs lie on one cone.
    nadir_base (3,), rho_rad : that cone.
    state : what the limb looked like.
    working : the search's images of the frames, one per frame.
    layer_rad : height of airglow above the limb. airglow : whether it shows.
    outside : of the other cameras, by name, how many edges agreed on one disc, a limb or not, when
    they were searched.
    elsewhere : those of them, by name, that saw a limb elsewhere by themselves, in words.
    step : from the set before; None right after a search that follows none of the same cameras.
    age : sets since the search.
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
    elsewhere: Mapping[str, str]
    step: ConeStep | None = None
    age: int = 0

    @classmethod
    def started(
        cls,
        views: Sequence[CameraView],
        detection: Detection,
        fit: HorizonFit,
        cameras: tuple[str, ...],
        outside: Mapping[str, int],
        elsewhere: Mapping[str, str],
    ) -> Track:
        """Track from a fit, with its disc, of what a search found. cameras, outside, elsewhere : as
        of the track.
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
            elsewhere=elsewhere,
        )

    def after(self, before: Track | None, since_s: float | None) -> Track:
        """Track with the step from the one that the set before had left, if it had.

        since_s : from that set on. So a limb that moves too far from set to set to be found where
        it was is followed after two searches.
        """
        if before is None or before.cameras != self.cameras:
            return self
        return replace(self, step=ConeStep(before.nadir_base, before.rho_rad, since_s))

    def continued(
        self,
        frames: Sequence[int],
        detection: Detection,
        fit: HorizonFit,
        since_s: float | None,
    ) -> Track:
        """Track with one more fit, with its disc. frames : numbers of its own that were followed.
        since_s : from the set before on.
        """
        assert fit.disc is not None
        return replace(
            self,
            nadir_base=fit.disc.nadir,
            rho_rad=fit.disc.rho_rad,
            step=ConeStep(self.nadir_base, self.rho_rad, since_s),
            state=self.state.with_looks(frames, detection),
            age=self.age + 1,
        )

    def numbers(self, views: Sequence[CameraView]) -> list[int] | None:
        """Which of its frames are of these cameras; None where one of them, its calibration
        included, is none of the track's, or all of them are `outside`.
        """
        own = {id(view): i for i, view in enumerate(self.views)}
        if not all(id(view) in own for view in views):
            return None
        if all(view.name in self.outside for view in views):
            return None
        return [own[id(view)] for view in views]

    def predicted_cone(
        self, rot_now_from_last: np.ndarray | None, since_s: float | None
    ) -> tuple[np.ndarray, float]:
        """Nadir (3,) and rho expected now: turned as the gyro says, or moved on as before.

        rot_now_from_last : (3, 3), see `Aiding`. since_s : from the last set on; where it is not
        known, or was not, sets are taken to come evenly.
        """
        if rot_now_from_last is not None:
            return rot_now_from_last @ self.nadir_base, self.rho_rad
        if self.step is None:
            return self.nadir_base, self.rho_rad
        before, rho, took_s = self.step
        steps = 1.0 if since_s is None or took_s is None else min(since_s / took_s, _FARTHEST)
        # The errors of nadir and rho hang together so that the limb in the frame is known far
        # better than either: moved on together they stay so.
        angle = angle_rad(before, self.nadir_base)
        ahead = self.nadir_base
        if angle > _LEAST_STEP_RAD:
            on, back = math.sin((1.0 + steps) * angle), math.sin(steps * angle)
            ahead = (on * self.nadir_base - back * before) / math.sin(angle)
        return ahead, self.rho_rad + steps * (self.rho_rad - rho)

    def moves_rad_s(
        self, rot_now_from_last: np.ndarray | None, since_s: float | None
    ) -> float | None:
        """How fast nadir moves, as the gyro says or as it did before; None where neither is known.

        rot_now_from_last, since_s : as of `predicted_cone`.
        """
        if since_s is not None and rot_now_from_last is not None:
            return angle_rad(self.nadir_base, rot_now_from_last @ self.nadir_base) / since_s
        if self.step is None or self.step.since_s is None:
            return None
        return angle_rad(self.step.nadir_base, self.nadir_base) / self.step.since_s
