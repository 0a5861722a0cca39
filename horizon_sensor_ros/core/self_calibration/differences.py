"""How far the cameras' nadirs lie apart, set by set: what a wrong mounting shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.mathematics.attitude import shortest_turn
from horizon_sensor_ros.core.self_calibration.measurement import FrameSet


@dataclass(frozen=True, eq=False)
class NadirDifference:
    """One instrument's nadir against another's over time.

    name : "camera_2 against camera_1". index : (K,) of the frame sets. turn_rad : (K, 3) rotation
    vectors, base frame, that take the second one's nadir to the first one's by the shortest way.
    """

    name: str
    index: np.ndarray
    turn_rad: np.ndarray

    @property
    def rms_rad(self) -> float:
        """Root mean square angle."""
        return float(np.sqrt(np.mean(np.sum(self.turn_rad**2, axis=1))))


def nadir_differences(
    sets: Sequence[FrameSet], rot_base_from_cam: Mapping[str, np.ndarray]
) -> tuple[NadirDifference, ...]:
    """Each camera against the first one that saw the horizon, or all against the reference; none
    of sets in which nobody did.

    rot_base_from_cam : (3, 3) of each camera by which its nadirs are taken to the base frame.
    """
    found: dict[str, list[tuple[int, np.ndarray]]] = {}
    for index, frames in enumerate(sets):
        nadirs = {h.camera: rot_base_from_cam[h.camera] @ h.nadir_cam for h in frames.horizons}
        if frames.reference is not None:
            nadirs = {"the reference": frames.reference.nadir_base, **nadirs}
        if not nadirs:
            continue
        (first, base), *others = nadirs.items()
        for name, nadir in others:
            turn = shortest_turn(base, nadir)
            found.setdefault(f"{name} against {first}", []).append((index, turn))
    return tuple(
        NadirDifference(name, np.array([i for i, _ in rows]), np.array([t for _, t in rows]))
        for name, rows in found.items()
    )
