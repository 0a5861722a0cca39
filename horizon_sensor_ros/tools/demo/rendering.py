"""The demo's images and clouds, drawn ahead by worker processes while the flight is under way."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.sim.flight import Flight
from horizon_sensor_ros.sim.tumbling import TumblingTarget

_WORKERS = 2


@dataclass(frozen=True, eq=False)
class Moment:
    """What the sensors see at one time, and the truth.

    images : one (H, W) uint8 a view. points : (H, W, 3) float32 of the range camera, NaN: no
    return. pose_tof_from_body : (4, 4) the target's own axes in the range camera's frame.
    """

    time_s: float
    images: tuple[np.ndarray, ...]
    points: np.ndarray
    nadir_base: np.ndarray
    altitude_m: float
    pose_tof_from_body: np.ndarray


@contextmanager
def rendered(
    flight: Flight, target: TumblingTarget, times_s: Sequence[float]
) -> Iterator[tuple[Future[Moment], ...]]:
    """Draw flight and target at the given times, in their order, until the block ends."""
    pool = ProcessPoolExecutor(
        _WORKERS,
        # Spawned, not forked: a copy of a process with DDS threads in it may hang.
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_in_the_background,
    )
    try:
        yield tuple(pool.submit(_moment, flight, target, time_s) for time_s in times_s)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _in_the_background() -> None:
    # The nodes come first on a small machine. Signals to the whole group, Ctrl-C and the like, are
    # for the demo itself, which then ends its workers.
    os.nice(5)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)


def _moment(flight: Flight, target: TumblingTarget, time_s: float) -> Moment:
    frames = flight.frames(time_s)
    truth = frames[0].truth
    images = tuple(frame.image for frame in frames)
    scan = target.scan(time_s)
    return Moment(
        time_s, images, scan.points, truth.nadir_base, truth.altitude_m, scan.pose_cam_from_target
    )
