"""`horizon_applicability --quality` and `--mounting`: maps, tables, answers, errors."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from horizon_sensor_ros.core.applicability.visibility import (
    cone_rays,
    horizon_in_view,
    rot_base_from_down,
)
from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.bound import (
    bound_of,
    horizon_bound,
    horizon_information,
    nadir_sigma_bound_rad,
)
from horizon_sensor_ros.core.mathematics.attitude import rotation_from_quaternion
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.tools.applicability.applicability import main
from horizon_sensor_ros.tools.applicability.mounting_angle import depression_deg, mountings, tilted
from horizon_sensor_ros.tools.applicability.quality_map import ALL, quality_maps

DOWN = np.array([0.0, 0.0, -1.0])
FORWARD, LEFT = [-0.5, 0.5, -0.5, 0.5], [-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]
CAMERA = Camera(320, 240, 280.0, 280.0, 159.5, 119.5)
PLANET = Planet()


def view(name: str, quaternion: list[float]) -> CameraView:
    return CameraView(name, CAMERA, rotation_from_quaternion(np.array(quaternion)))


VIEWS = (view("camera_1", FORWARD), view("camera_2", LEFT))


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    camera = {"width": 320, "height": 240, "fx": 280.0}
    cameras = {
        "camera_1": camera | {"rotation": FORWARD},
        "camera_2": camera | {"rotation": [float(v) for v in LEFT]},
    }
    path = tmp_path / "rig.yaml"
    path.write_text(yaml.safe_dump({"altitude_km": 500.0, "cameras": cameras}))
    return path


def rows_of(path: Path) -> list[dict[str, float]]:
    with path.open() as file:
        return [
            {key: float(value) if value else np.inf for key, value in row.items()}
            for row in csv.DictReader(file)
        ]


def test_informations_add_up_to_the_bound() -> None:
    nadir = np.array([0.2, -0.1, -0.9])
    nadir /= np.linalg.norm(nadir)
    views = [tilted(v, DOWN, 25.0) for v in VIEWS]
    parts = [horizon_information(v, PLANET, nadir, 500e3, 0.1) for v in views]
    cov = horizon_bound(views, PLANET, nadir, 500e3, 0.1)
    whole = np.sqrt(np.linalg.eigvalsh(cov[:3, :3])[-1])
    assert nadir_sigma_bound_rad(sum(parts)) == pytest.approx(whole, rel=1e-9)
    assert nadir_sigma_bound_rad(np.zeros((3, 3))) == np.inf
    assert np.isnan(bound_of(np.zeros((3, 3)))).all()


def test_quality_of_both_is_better_than_of_one(rig: Path, tmp_path: Path, capsys) -> None:
    prefix = tmp_path / "q"
    given = ["--quality", "--range", "-30", "30", "--step", "6", "-o", str(prefix)]
    assert main([str(rig), *given]) == 0
    answer = capsys.readouterr().out
    assert answer.count("\n") == 1
    assert "sigma below 0.5 deg at these shares of 121 attitudes: camera_1 " in answer
    rows = rows_of(prefix.with_suffix(".csv"))
    # Over roll and pitch when it is not said.
    assert list(rows[0])[:2] == ["roll_deg", "pitch_deg"]
    for row in rows:
        one, two, both = (row[f"{n}_sigma_deg"] for n in ("camera_1", "camera_2", "all_cameras"))
        assert both <= min(one, two) * (1 + 1e-9)
        assert np.isfinite(one) <= (row["camera_1_share"] > 0)
        total = row["camera_1_share"] + row["camera_2_share"]
        assert row["all_cameras_share"] == pytest.approx(total, abs=1e-6)
    picture = cv2.imread(str(prefix.with_suffix(".png")))
    assert picture is not None
    # A row for each camera and one for both, two pictures in each.
    assert picture.shape[0] > picture.shape[1] > 600


def test_quality_is_that_of_visibility_and_bound() -> None:
    attitudes = rot_base_from_down(np.radians([0.0, 10.0]), np.radians([20.0, 30.0]), 0.0)
    rays = cone_rays(PLANET.rho_from_altitude(500e3))
    maps = quality_maps(VIEWS, rays, attitudes, PLANET, 500e3, 0.1)
    assert list(maps) == ["camera_1", "camera_2", ALL]
    share = horizon_in_view(VIEWS[0], rays, attitudes).fraction
    np.testing.assert_array_equal(maps["camera_1"].share, share)
    for i, attitude in enumerate(attitudes):
        cov = horizon_bound(VIEWS, PLANET, attitude[:, 2], 500e3, 0.1)
        sigma = np.sqrt(np.linalg.eigvalsh(cov[:3, :3])[-1])
        assert maps[ALL].sigma_rad[i] == pytest.approx(sigma, rel=0.02)
    assert list(quality_maps(VIEWS[:1], rays, attitudes, PLANET, 500e3, 0.1)) == ["camera_1"]


@given(
    angle=st.floats(-80.0, 80.0),
    start=st.floats(-60.0, 60.0),
    azimuth=st.floats(-180.0, 180.0),
)
def test_a_tilted_camera_looks_that_far_down(angle: float, start: float, azimuth: float) -> None:
    yaw = np.radians(azimuth)
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    base = CameraView("c", CAMERA, turn @ VIEWS[0].rot_base_from_cam)
    turned = tilted(tilted(base, DOWN, start), DOWN, angle)
    assert depression_deg(turned, DOWN) == pytest.approx(angle, abs=1e-6)
    axis = turned.rot_base_from_cam[:, 2]
    assert np.cos(np.arctan2(axis[1], axis[0]) - yaw) == pytest.approx(1.0, abs=1e-9)
    # The frame's rows stay level.
    assert abs(turned.rot_base_from_cam[2, 0]) < 1e-9


def test_the_best_angle_has_the_horizon_in_the_frame_at_all_altitudes() -> None:
    found = mountings(VIEWS, PLANET, DOWN, (300e3, 1200e3), 0.1, tilt_deg=5.0, step_deg=5.0)
    best = found.depression_deg[found.best]
    half_deg = np.degrees(np.arctan(119.5 / 280.0))
    for height, sigma in zip(found.altitudes_m, found.sigma_rad[found.best], strict=True):
        dip = 90 - np.degrees(PLANET.rho_from_altitude(height))
        assert abs(best - dip) < half_deg + 5
        assert np.isfinite(sigma)
    # A craft that leans sees less at worst than one that does not.
    level = mountings(VIEWS, PLANET, DOWN, (300e3, 1200e3), 0.1, step_deg=5.0)
    assert np.all(found.sigma_rad >= level.sigma_rad * (1 - 1e-9))
    assert not np.isfinite(found.sigma_rad[-1].max()), "straight down there is no horizon"


def test_mounting_from_the_command_line(rig: Path, tmp_path: Path, capsys) -> None:
    prefix = tmp_path / "m"
    assert main([str(rig), "--mounting", "400", "800", "-o", str(prefix)]) == 0
    answer = capsys.readouterr().out
    assert answer.count("\n") == 1
    assert answer.startswith("best ")
    assert "deg below the horizontal (camera_1 now 0.0, camera_2 now 0.0)" in answer
    rows = rows_of(prefix.with_suffix(".csv"))
    assert {row["altitude_km"] for row in rows} >= {400.0, 800.0}
    best = float(answer.split()[1])
    assert all(np.isfinite(r["sigma_deg"]) for r in rows if r["below_horizontal_deg"] == best)
    assert cv2.imread(str(prefix.with_suffix(".png"))) is not None


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("applicability", []),
        ("quality", ["--quality"]),
        ("mounting", ["--mounting", "500", "500"]),
        ("figure6", ["--figure6"]),
    ],
)
def test_names_of_the_files_are_those_that_the_help_has(
    name: str,
    options: list[str],
    rig: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    said = re.search(r"-o PREFIX.*?\((default[^)]*)\)", capsys.readouterr().out, re.S)
    assert said
    assert re.search(rf"\b{name}\b", said[1])
    where = tmp_path / "empty"
    where.mkdir()
    monkeypatch.chdir(where)
    coarse = [] if "--mounting" in options else ["--step", "45"]
    assert main([*([] if name == "figure6" else [str(rig)]), *options, *coarse]) == 0
    assert {path.name for path in where.iterdir()} == {f"{name}.png", f"{name}.csv"}


def test_no_angle_may_do(rig: Path, tmp_path: Path, capsys) -> None:
    given = ["--mounting", "200", "30000", "-o", str(tmp_path / "m")]
    assert main([str(rig), *given]) == 0
    assert "no angle works at all of 200 to 30000 km; " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--mounting", "800", "400"], "--mounting must be two altitudes"),
        (["--mounting", "400", "800", "--tilt", "-1"], "--tilt must be 0 to 45"),
        (["--mounting", "400", "800", "--sigma", "0"], "--sigma must be positive"),
        (["--quality", "--step", "0"], "--step must be positive"),
        (["--quality", "--altitude", "-5"], "--altitude must be above the limb, 0 km, got -5"),
        (["--altitude", "nan"], "--altitude must be above the limb"),
        (["--quality", "--cameras", "camera_9"], "no camera 'camera_9'"),
    ],
)
def test_errors_name_the_option(rig: Path, options: list[str], said: str, capsys) -> None:
    assert main([str(rig), *options]) == 2
    errors = capsys.readouterr().err
    assert said in errors
    assert "Traceback" not in errors


def test_a_place_without_a_folder_is_said(rig: Path, capsys) -> None:
    assert main([str(rig), "-o", "/dev/null/map"]) == 1
    assert "cannot write /dev/null/map.png: Not a directory" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--mounting", "300", "800", "--axes", "yaw,pitch"], "--axes has no effect with --mount"),
        (["--mounting", "300", "800", "--step", "1"], "--step has no effect with --mounting"),
        (["--mounting", "300", "800", "--altitude", "5"], "--altitude has no effect with --mount"),
        (["--quality", "--trials", "5"], "--trials has no effect with --quality"),
        (["--quality", "--tilt", "5"], "--tilt has no effect with --quality"),
        (["--figure6", "--sigma", "0.2"], "--sigma has no effect with --figure6"),
        (["--figure6"], "--figure6 has its own cameras"),
    ],
)
def test_options_that_another_question_has_are_refused(
    rig: Path, options: list[str], said: str, capsys
) -> None:
    with pytest.raises(SystemExit) as caught:
        main([str(rig), *options])
    assert caught.value.code == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    "options", [["--quality", "--mounting", "1", "2"], ["--quality", "--error", "arc"]]
)
def test_one_question_at_a_time(rig: Path, options: list[str], capsys) -> None:
    with pytest.raises(SystemExit) as caught:
        main([str(rig), *options])
    assert caught.value.code == 2
    assert "--quality" in capsys.readouterr().err


def test_a_tilt_is_asked_of_the_mounting_alone(rig: Path, capsys) -> None:
    with pytest.raises(SystemExit) as caught:
        main([str(rig), "--tilt", "5"])
    assert caught.value.code == 2
    assert "--tilt is asked of --mounting alone" in capsys.readouterr().err


def test_a_camera_that_looks_straight_down_cannot_be_tilted(tmp_path: Path, capsys) -> None:
    camera = {"width": 320, "height": 240, "fx": 280.0, "rotation": [1.0, 0.0, 0.0, 0.0]}
    path = tmp_path / "rig.yaml"
    path.write_text(yaml.safe_dump({"cameras": {"camera_1": camera}}))
    assert main([str(path), "--mounting", "400", "800", "-o", str(tmp_path / "m")]) == 2
    assert "camera_1 looks straight up or down" in capsys.readouterr().err
