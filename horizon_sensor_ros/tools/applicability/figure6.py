"""Paper A's figure 6: its camera, and its map beside what the printed approximation gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from horizon_sensor_ros.core.applicability.section_circle import (
    section_circle,
    section_circle_in_frame,
)
from horizon_sensor_ros.core.applicability.visibility import (
    Visibility,
    horizon_in_view,
    horizon_rays,
    limb_in_view,
    rot_base_from_down,
)
from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.tools.camera_file import Rig

# Fine enough that the difference of the two maps is the approximation's, not the sampling's.
_CIRCLE_SAMPLES = 14400


def paper_rig() -> Rig:
    """The two-camera layout of papers A and B at 300 km.

    The long axis (x) is upright at zero angles; camera 1 looks along y, camera 2 along z, both with
    the planet at the frame's bottom. The cone through the frame's corners has a half-aperture of
    28 deg.
    """
    width, height = 640, 480
    focal = np.hypot(width, height) / 2 / np.tan(np.radians(28.0))
    camera = Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    down = (-1.0, 0.0, 0.0)
    return Rig(
        views=(
            CameraView("camera_1", camera, np.column_stack([(0, 0, -1), down, (0, 1, 0)])),
            CameraView("camera_2", camera, np.column_stack([(0, 1, 0), down, (0, 0, 1)])),
        ),
        planet=Planet(),
        altitude_m=300e3,
        nadir_at_zero=np.array(down),
    )


@dataclass(frozen=True, eq=False)
class Figure6:
    """The maps, flat over (yaw, pitch), and what can be said of them.

    first, second : exact, of the two cameras. circle_fraction, circle_px : of the first, by the
    section circle. both_as_printed : bool, the first map and itself turned by 90 deg. maximum_deg :
    yaw and pitch where the first has the horizon along the diagonal (also at minus that pitch).
    exact_px, circle_limb_px : (N, 2) the horizon in the first frame there, both ways.
    """

    camera: Camera
    first: Visibility
    second: Visibility
    circle_fraction: np.ndarray
    circle_px: np.ndarray
    both_as_printed: np.ndarray
    maximum_deg: tuple[float, float]
    exact_px: np.ndarray
    circle_limb_px: np.ndarray

    @property
    def both(self) -> np.ndarray:
        """Whether both cameras see the horizon."""
        return self.first.visible & self.second.visible

    @property
    def difference_px(self) -> np.ndarray:
        """Length by the section circle minus the exact one, NaN where neither sees the horizon."""
        either = self.first.visible | (self.circle_fraction > 0)
        return np.where(either, self.circle_px - self.first.arc_px, np.nan)

    @property
    def circle_offset_px(self) -> float:
        """Largest distance of the section circle from the horizon in that frame."""
        return float(np.hypot(*(self.circle_limb_px - self.exact_px).T).max())


def figure6(yaw_deg: np.ndarray, pitch_deg: np.ndarray, altitude_m: float) -> Figure6:
    """Compute figure 6 over attitudes yaw_deg, pitch_deg (M,), with a progress bar.

    Raises ValueError for an altitude so high that the planet's disc is smaller than the frame.
    """
    rig = paper_rig()
    view, second_view = rig.views
    rays = horizon_rays(rig.planet, altitude_m)
    rho = rig.planet.rho_from_altitude(altitude_m)
    best = diagonal_maximum_deg(view.camera, rho)
    if np.isnan(best[0]):
        raise ValueError(
            f"figure 6 needs a horizon wider than the frame: at {altitude_m / 1e3:g} km the planet "
            f"is a disc of {2 * np.degrees(rho):.0f} deg; take a lower altitude"
        )

    def attitudes(yaw: np.ndarray | float, pitch: np.ndarray | float) -> np.ndarray:
        return rot_base_from_down(0.0, np.radians(pitch), np.radians(yaw), rig.nadir_at_zero)

    with tqdm(total=4, desc="figure 6", unit="map", leave=False) as bar:
        first = horizon_in_view(view, rays, attitudes(yaw_deg, pitch_deg))
        bar.update()
        second = horizon_in_view(second_view, rays, attitudes(yaw_deg, pitch_deg))
        bar.update()
        # "Turned by 90 degrees clockwise about the origin": what was at (-pitch, yaw).
        turned = horizon_in_view(view, rays, attitudes(-pitch_deg, yaw_deg))
        bar.update()
        nadir_cam = (view.rot_base_from_cam.T @ attitudes(yaw_deg, pitch_deg))[:, :, 2]
        focal = view.camera.fx
        fraction, length = section_circle_in_frame(
            nadir_cam,
            rho,
            view.camera.width / 2 / focal,
            view.camera.height / 2 / focal,
            samples=_CIRCLE_SAMPLES,
        )
        bar.update()
    at_best = attitudes(*best)
    exact_px = limb_in_view(view, horizon_rays(rig.planet, altitude_m, 7200), at_best[0]).px
    return Figure6(
        camera=view.camera,
        first=first,
        second=second,
        circle_fraction=fraction,
        circle_px=length * focal,
        both_as_printed=first.visible & turned.visible,
        maximum_deg=best,
        exact_px=exact_px,
        circle_limb_px=_on_circle(view, at_best, rho, exact_px),
    )


def diagonal_maximum_deg(camera: Camera, rho_rad: float) -> tuple[float, float]:
    """Yaw and pitch (deg) at which camera 1 of `paper_rig` has the horizon in opposite corners.

    That is the most of a horizon that a frame can hold: both corner rays lie alpha off the axis and
    rho off nadir, so the axis is ``asin(cos rho / cos alpha)`` below level (yaw), the frame turned
    about it by its diagonal's angle (pitch). NaN where no horizon reaches from corner to corner.
    """
    alpha = np.arctan(np.hypot(camera.width, camera.height) / 2 / camera.fx)
    sine = np.cos(rho_rad) / np.cos(alpha)
    yaw = np.degrees(np.arcsin(sine)) if sine <= 1 else np.nan
    return float(yaw), float(np.degrees(np.arctan2(camera.height, camera.width)))


def _on_circle(
    view: CameraView, attitude: np.ndarray, rho: float, limb_px: np.ndarray
) -> np.ndarray:
    """Points (N, 2) of the section circle nearest to the limb's."""
    camera = view.camera
    circle = section_circle((view.rot_base_from_cam.T @ attitude)[:, :, 2], rho)
    centre = circle.centre[0] * camera.fx + (camera.cx, camera.cy)
    outwards = limb_px - centre
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    return centre + outwards * circle.radius[0] * camera.fx
