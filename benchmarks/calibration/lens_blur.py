"""Lenses that blur more in the corners: what a recording tells of them, and what that is worth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from tqdm import tqdm

from calibration.self_calibration import swinging_flight
from horizon.errors import FixErrors
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.self_calibration.corner_blur import LensBlur, lens_blurs
from horizon_sensor_ros.core.self_calibration.measurement import FrameSet, camera_horizon
from horizon_sensor_ros.sim.earth_scene import Imaging
from horizon_sensor_ros.sim.flight import Flight
from horizon_sensor_ros.sim.frame_truth import FrameTruth
from tables import Options, Table, number

COLUMNS = (
    "clouds",
    "blur in the corners",
    "found",
    "sigma",
    "told",
    *FixErrors.COLUMNS,
)
NOTES = (
    "blur in the corners: more than the .6 px in the middle, one sigma of an edge, pixels. found: "
    "of either camera, in a recording of so many sets, one in 20 s, as `horizon_self_calibration` "
    "tells it; halfway out a simulated lens blurs by some .8 of what it would by the law that is "
    "assumed, and that is what limbs show.",
    "told: `camera_N.corner_blur` is what was found. Frames of another flight, each camera by "
    "itself. nadir: angle to the true one, degrees. NEES: mean of the squared nadir error in the "
    "fit's own sigmas (2 is right); beyond 3 sigma: how many are above 11.8.",
)
_CONTRASTS = {"faint": 0.3, "full": 1.0}
_MIDDLE_PX = 0.6
_CORNERS_PX = (0.6, 0.75, 0.95)
_SPACING_S = 20.0
_SETS_A_FRAME = 0.2  # of those that `--frames` asks for


def run(options: Options) -> list[Table]:
    """Two rows a lens and kind of clouds: not told, and told what another flight showed."""
    count = max(12, round(_SETS_A_FRAME * options.frames))
    rows = []
    for clouds, contrast in _CONTRASTS.items():
        for corner_px in _CORNERS_PX:
            rng = np.random.default_rng([options.seed, 0x1E])
            imaging = Imaging(noise_dn=4.0, psf_sigma_px=_MIDDLE_PX, corner_psf_px=corner_px)
            recorded, flown = (
                replace(swinging_flight(rng, {"cloud_contrast": contrast}), imaging=imaging)
                for _ in range(2)
            )
            name = f"{clouds}, {corner_px} px"
            lenses = _found(recorded, count, name)
            first = (clouds, number(imaging.corner_blur_px, 3), *_cells(lenses))
            for told, cells in _flown(flown, lenses, count, name).items():
                rows.append((*(first if told == "no" else ("",) * len(first)), told, *cells))
    title = f"Lenses that blur more in the corners, {count} sets a flight"
    return [Table(title, COLUMNS, tuple(rows), NOTES)]


def _found(flight: Flight, count: int, name: str) -> tuple[LensBlur, ...]:
    """What a recording of a flight tells of its cameras' lenses."""
    sets = []
    for time_s, frames, _ in _frames(flight, count, f"{name}: recording"):
        alone = [
            camera_horizon(frame.view, HorizonSensor().process([frame]), Planet())
            for frame in frames
        ]
        sets.append(FrameSet(time_s, tuple(each for each in alone if each is not None)))
    return lens_blurs(sets, [view.name for view in flight.views], _SPACING_S)


def _flown(
    flight: Flight, lenses: tuple[LensBlur, ...], count: int, name: str
) -> dict[str, tuple[str, ...]]:
    """Errors of each camera by itself, not told of its lens and told."""
    found = {"no": FixErrors(), "yes": FixErrors()}
    sensor = HorizonSensor(HorizonConfig(tracking=False))
    for _, frames, truth in _frames(flight, count, f"{name}: flight"):
        for frame, lens in zip(frames, lenses, strict=True):
            view = replace(frame.view, corner_blur_px=max(lens.blur_px, 0.0))
            found["no"].add(sensor, [frame], truth)
            found["yes"].add(sensor, [replace(frame, view=view)], truth)
    return {told: errors.cells() for told, errors in found.items()}


def _frames(
    flight: Flight, count: int, name: str
) -> Iterator[tuple[float, list[Frame], FrameTruth]]:
    """Time, frames and truth of each set."""
    for i in tqdm(range(count), desc=name, unit="set"):
        drawn = flight.frames(_SPACING_S * i)
        frames = [Frame(v, one.image) for v, one in zip(flight.views, drawn, strict=True)]
        yield _SPACING_S * i, frames, drawn[0].truth


def _cells(lenses: tuple[LensBlur, ...]) -> tuple[str, str]:
    """Blurs that were found, and their sigmas."""
    return (
        ", ".join(number(lens.blur_px, 3) for lens in lenses),
        ", ".join(number(lens.sigma_px, 3) for lens in lenses),
    )
