"""Whether the covariance of the demo's flight holds: the flight itself, and others like it.

Errors of one flight hang together: the clouds and the air at the limb stay much the same from frame
to frame. So one flight's mean says little more of the covariance than a few frames far apart would;
the mean over flights past other clouds tells. NEES is of altitude, roll and pitch together (3 is
right), and of each by itself (1 for the altitude, 2 for nadir). Like the node, but without ROS.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from tqdm import tqdm

from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.sim.flight import Flight
from horizon_sensor_ros.sim.frame_truth import FrameTruth

# 95 % of chi-squared with three degrees of freedom.
_WITHIN_95 = 7.815


def another(seed: int) -> Flight:
    """Return the demo's craft somewhere else on its orbit, above other clouds; 0 is the demo's."""
    flight = Flight(seed=seed)
    if seed == 0:
        return flight
    rng = np.random.default_rng([seed, 0x66])
    node, start = rng.uniform(0.0, 2.0 * np.pi, 2)
    scene = replace(flight.scene, texture_seed=int(rng.integers(2**31)))
    return replace(flight, node_rad=float(node), start_rad=float(start), scene=scene)


def flown(flight: Flight, seconds: float, rate_hz: float) -> np.ndarray:
    """Rows of NEES (all, altitude, nadir) and the altitude's error in sigmas, one a fix."""
    sensor, rows = HorizonSensor(), []
    for time_s in np.arange(0.0, seconds, 1.0 / rate_hz):
        drawn = flight.frames(float(time_s))
        fix = sensor.process([Frame(v, f.image) for v, f in zip(flight.views, drawn, strict=True)])
        if fix.ok:
            rows.append(_nees(fix.fit, drawn[0].truth))
    return np.array(rows).reshape(-1, 4)


def _nees(fit: HorizonFit, truth: FrameTruth) -> tuple[float, float, float, float]:
    basis = np.zeros((4, 3))
    basis[:3, :2], basis[3, 2] = tangent_basis(truth.nadir_base), 1.0
    error = basis.T @ np.append(fit.nadir_base, fit.altitude_m - truth.altitude_m)
    cov = basis.T @ fit.cov_nadir_altitude @ basis
    nadir, altitude = error[:2], float(error[2] / np.sqrt(cov[2, 2]))
    of_all = float(error @ np.linalg.solve(cov, error))
    return of_all, altitude**2, float(nadir @ np.linalg.solve(cov[:2, :2], nadir)), altitude


def main() -> None:
    """Print a line a flight, and one for all but the demo's."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--flights", type=int, default=20, help="beside the demo's (default 20)")
    parser.add_argument("--seconds", type=float, default=20.0, help="length (default 20)")
    parser.add_argument("--rate", type=float, default=0.5, help="pairs a second (default 0.5)")
    arguments = parser.parse_args()
    print(f"{'flight':8}{'fixes':>6}{'NEES':>7}{'altitude':>10}{'nadir':>7}{'within 95 %':>13}")
    others = []
    for seed in tqdm(range(arguments.flights + 1), unit="flight"):
        rows = flown(another(seed), arguments.seconds, arguments.rate)
        if not len(rows):
            continue
        _line("demo's" if seed == 0 else f"{seed}", rows)
        if seed:
            others.append(rows)
    if others:
        _line("all but", np.concatenate(others))
        means = np.array([rows[:, 0].mean() for rows in others])
        print(
            f"mean NEES of one flight, over {len(means)}: median {np.median(means):.2f}, from "
            f"{means.min():.2f} to {means.max():.2f}"
        )
        # Of all variance of the altitude's error, the part that a flight's own mean holds.
        between = np.var([rows[:, 3].mean() for rows in others])
        whole = np.var(np.concatenate([rows[:, 3] for rows in others]))
        print(
            f"share of the altitude's variance (in sigmas) between flights: {between / whole:.0%}"
        )


def _line(name: str, rows: np.ndarray) -> None:
    of_all, altitude, nadir = rows[:, :3].mean(axis=0)
    within = float(np.mean(rows[:, 0] < _WITHIN_95))
    tqdm.write(f"{name:8}{len(rows):6}{of_all:7.2f}{altitude:10.2f}{nadir:7.2f}{within:13.0%}")


if __name__ == "__main__":
    main()
