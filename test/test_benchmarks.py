"""The benchmark's parts on a handful of frames, and the arithmetic that its tables rest on."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.status import Status

ROOT = Path(__file__).parents[1]
BENCHMARKS = ROOT / "benchmarks"

pytestmark = pytest.mark.usefixtures("modules_of_the_benchmark")


def run_benchmark(
    out: Path, *arguments: str, **environment: str
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(BENCHMARKS / "run.py"), "--out", str(out), *arguments],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **environment},
        cwd=out.parent,
    )


def test_parts_print_their_tables_and_write_them(tmp_path: Path) -> None:
    parts = (
        *("horizon_methods", "paper_c", "horizon_hard"),
        *("horizon_alone", "horizon_figure", "horizon_sun"),
    )
    done = run_benchmark(tmp_path / "out", "--frames", "2", "--hard-scenes", "4", "--only", *parts)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "horizon_hard.png").stat().st_size > 10000
    for part in parts:
        written = (tmp_path / "out" / f"{part}.md").read_text()
        assert written.startswith("## ")
        assert written in done.stdout
    methods = (tmp_path / "out" / "horizon_methods.md").read_text()
    for heading in (
        "Set A (2)",
        "Set B (2)",
        "Set C (2)",
        "Set D (2)",
        "Set E (2)",
        "Two cameras (1)",
    ):
        assert heading in methods
    default = [line for line in methods.splitlines() if "(default) " in line]
    assert len(default) == 6
    assert "nan" not in methods
    paper_c = (tmp_path / "out" / "paper_c.md").read_text().splitlines()
    steps = [line for line in paper_c if line.startswith("|") and "as the paper" in line]
    assert len(steps) == 10
    assert all("met (5)" in line for line in steps)


def test_absent_shared_data_are_said_to_be(tmp_path: Path) -> None:
    done = run_benchmark(
        tmp_path / "out", "--only", "horizon_scenes", HORIZON_SHARED_DATA=str(tmp_path / "none")
    )
    assert done.returncode == 0, done.stderr
    assert "skipped: earth_scenes absent" in done.stdout
    assert "skipped: earth_real absent" in done.stdout


def test_hard_scenes_of_some_kinds_only(tmp_path: Path) -> None:
    kinds = ("--kinds", "airglow", "flat", "--hard-scenes", "2")
    done = run_benchmark(tmp_path / "out", "--only", "horizon_alone", *kinds)
    assert done.returncode == 0, done.stderr
    rows = [line.split()[1] for line in done.stdout.splitlines() if line.startswith("| ")]
    assert set(rows) - {"airglow"} == {"kind", "flat", "all"}


@pytest.mark.parametrize(
    ("option", "what"), [("--only", "nothing"), ("--kinds", "fog"), ("--targets", "moth")]
)
def test_what_is_unknown_is_refused(tmp_path: Path, option: str, what: str) -> None:
    done = run_benchmark(tmp_path / "out", option, what)
    assert done.returncode == 2
    assert what in done.stderr


def test_scenes_make_a_bag_that_replays(tmp_path: Path) -> None:
    """Two scenes of our own under the shared ones' names and format: a horizon, and darkness."""
    from horizon import bags, scenes

    from horizon_sensor_ros.sim.earth_camera import render_views
    from horizon_sensor_ros.sim.earth_scene import EarthScene
    from horizon_sensor_ros.sim.poses import camera_from_fov, pose_from_attitude, side_views

    camera = camera_from_fov(640, 480, np.radians(60.0))
    rot, position = pose_from_attitude(500e3, np.radians(18.0), np.radians(-20.0))
    frames = render_views(side_views(camera), rot, position, EarthScene(), np.random.default_rng(0))
    truth = {
        "nadir_body": frames[0].truth.nadir_base.tolist(),
        "geodetic_nadir_body": None,
        "altitude_km": 500.0,
        "fx": camera.fx,
        "cx": camera.cx,
        "cy": camera.cy,
        "width": 640,
        "height": 480,
        "model": "plumb_bob",
        "distortion": [0.0] * 5,
    }
    for k, frame in enumerate(frames, 1):
        cv2.imwrite(str(tmp_path / f"flat0_{k}.png"), frame.image)
        cv2.imwrite(str(tmp_path / f"night0_{k}.png"), np.full_like(frame.image, 4))
    drawn = [{**truth, "name": f"{kind}0", "kind": kind} for kind in ("flat", "night")]
    (tmp_path / "truth.json").write_text(json.dumps(drawn))

    flat, night = scenes.scenes_table(tmp_path).rows
    assert float(flat[1]) < 0.01
    assert abs(float(flat[4])) < 1.0
    assert flat[6] == "met (0.04)"
    assert night[1] == "no fix"
    assert night[6] == night[8] == "met (no fix)"
    assert bags.read_scenes(tmp_path) == drawn


def test_missed_bars_are_marked() -> None:
    from tables import verdict

    assert verdict(0.004, 0.004) == "met (0.004)"
    assert verdict(0.0041, 0.004) == "MISSED (0.004)"
    assert verdict(np.nan, 0.004) == "MISSED (0.004)"


def test_errors_of_a_fit_are_those_made() -> None:
    from horizon.errors import fit_errors

    truth = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    basis = tangent_basis(truth)
    sigma, angle = 1e-3, 2e-3
    nadir = np.cos(angle) * truth + np.sin(angle) * basis[:, 0]
    cov = np.zeros((4, 4))
    cov[:3, :3] = sigma**2 * basis @ basis.T
    fit = HorizonFit(Status.OK, "", "ml", nadir, 1.0, 505e3, cov)
    errors = fit_errors(fit, truth, 500e3)
    assert errors.nadir_deg == pytest.approx(np.degrees(angle))
    assert errors.altitude_percent == pytest.approx(1.0)
    assert errors.nees == pytest.approx((angle / sigma) ** 2, rel=1e-4)


def test_edge_sigma_is_what_a_matched_filter_reaches() -> None:
    """Place of a blurred vertical step by least squares on noisy rows, one pixel of edge each."""
    from horizon.errors import edge_sigma_px

    rng = np.random.default_rng(1)
    step, noise, psf, rows = 180.0, 2.0, 0.7, 20000
    fine = np.arange(-16.0, 16.0, 1.0 / 64.0)
    edge = cv2.GaussianBlur((fine > 0.0).astype(np.float64)[None], (0, 0), psf * 64.0)[0]
    # Pixels average over their own width; slope per pixel of shift.
    inside = edge.reshape(-1, 64).mean(axis=1)
    shifted = np.roll(edge, 4).reshape(-1, 64).mean(axis=1)
    slope = step * (shifted - inside)[2:-2] / (4.0 / 64.0)
    errors = rng.normal(0.0, noise, (rows, slope.size)) @ slope / (slope @ slope)
    expected = edge_sigma_px(np.full(7, step), np.sqrt(noise**2 - 1.0 / 12.0), psf)
    assert np.std(errors) == pytest.approx(expected, rel=0.04)


def test_errors_of_a_flight_are_in_its_own_sigmas() -> None:
    from demo_flights import _nees, another

    from horizon_sensor_ros.sim.flight import Flight

    drawn = Flight().frames(0.0)[0].truth
    basis = tangent_basis(drawn.nadir_base)
    nadir = drawn.nadir_base + 2e-3 * basis[:, 0]
    cov = np.zeros((4, 4))
    cov[:3, :3], cov[3, 3] = 1e-6 * basis @ basis.T, 300.0**2
    fit = HorizonFit(Status.OK, "", "ml", nadir, 1.0, drawn.altitude_m - 900.0, cov)
    assert _nees(fit, drawn) == pytest.approx((4.0 + 9.0, 9.0, 4.0, -3.0), rel=1e-4)
    # The first is the demo's own flight; the others are elsewhere, above other clouds.
    assert another(0) == Flight(seed=0)
    assert another(1).scene.texture_seed != Flight().scene.texture_seed
