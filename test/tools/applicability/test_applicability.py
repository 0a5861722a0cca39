"""`horizon_applicability`: files written, figures read back, and errors a user can act on."""

from __future__ import annotations

import csv
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from matplotlib.figure import Figure
from small_files import no_larger_files

from horizon_sensor_ros.tools.applicability.applicability import main
from horizon_sensor_ros.tools.applicability.figure6 import diagonal_maximum_deg, paper_rig
from horizon_sensor_ros.tools.applicability.figures import AngleGrid, Panel, draw_panel
from horizon_sensor_ros.tools.camera_file import CameraFileError, read_camera_file

EXAMPLE = Path(__file__).parents[3] / "config" / "applicability_example.yaml"


@pytest.fixture
def content() -> dict:
    """The example, as a mapping to spoil."""
    return yaml.safe_load(EXAMPLE.read_text())


def rows_of(path: Path) -> list[dict[str, float]]:
    with path.open() as file:
        return [
            {key: float(value) if value else np.nan for key, value in row.items()}
            for row in csv.DictReader(file)
        ]


def written(tmp_path: Path, content: object) -> Path:
    path = tmp_path / "rig.yaml"
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    return path


def test_example_is_the_papers_layout():
    rig, paper = read_camera_file(EXAMPLE), paper_rig()
    assert rig.altitude_m == paper.altitude_m == 300e3
    assert rig.planet == paper.planet
    np.testing.assert_allclose(rig.nadir_at_zero, paper.nadir_at_zero)
    for ours, theirs in zip(rig.views, paper.views, strict=True):
        assert ours.name == theirs.name
        assert (ours.camera.width, ours.camera.height) == (640, 480)
        assert ours.camera.fx == pytest.approx(theirs.camera.fx, rel=1e-12)
        np.testing.assert_allclose(ours.rot_base_from_cam, theirs.rot_base_from_cam, atol=1e-12)
    axes = [view.rot_base_from_cam[:, 2] for view in paper.views]
    assert axes[0] @ axes[1] == axes[0][0] == axes[1][0] == 0.0


def test_map_of_the_example(tmp_path, capsys):
    prefix = tmp_path / "out" / "map"
    arguments = [str(EXAMPLE), "--range", "-60", "60", "--step", "5", "-o", str(prefix)]
    assert main([*arguments, "--error", "bound"]) == 0
    answer = capsys.readouterr().out
    assert answer.count("\n") == 1
    assert "horizon in all cameras at" in answer
    assert "nadir error by bound" in answer
    rows = rows_of(prefix.with_suffix(".csv"))
    assert len(rows) == 25 * 25
    assert [rows[0]["yaw_deg"], rows[0]["pitch_deg"], rows[1]["yaw_deg"]] == [-60, -60, -55]
    for row in rows:
        both = row["camera_1_arc_px"] > 0 and row["camera_2_arc_px"] > 0
        assert row["in_field"] == both
        assert np.isfinite(row["error_deg"]) == both
        assert row["camera_1_longest_px"] <= row["camera_1_arc_px"] + 1e-3
    image = cv2.imread(str(prefix.with_suffix(".png")))
    assert image is not None
    assert min(image.shape[:2]) > 600


def test_any_camera_one_camera_and_least_arc(tmp_path):
    prefix = tmp_path / "map"
    arguments = [str(EXAMPLE), "--step", "10", "-o", str(prefix)]

    def field(*options: str) -> list[tuple[bool, float, float]]:
        assert main([*arguments, *options]) == 0
        return [
            (row["in_field"] == 1, row["camera_1_arc_px"], row.get("camera_2_arc_px", np.nan))
            for row in rows_of(prefix.with_suffix(".csv"))
        ]

    assert all(seen == (one > 0 or two > 0) for seen, one, two in field("--any"))
    assert all(seen == (one > 0) for seen, one, _ in field("--cameras", "camera_1"))
    assert all(seen == (min(one, two) > 300) for seen, one, two in field("--min-arc", "300"))


def test_a_level_craft_over_roll_and_pitch(tmp_path, content):
    """Yaw changes nothing there, and rolling by some angle lowers a camera on the side by it."""
    del content["nadir_at_zero"]
    content["planet"] = {"shape": "wgs84", "latitude_deg": 45, "heading_deg": 90}
    camera = content["cameras"].pop("camera_2")
    # Looks to the right (-y), image down along -z.
    camera["rotation"] = [0.7071068, 0.0, 0.0, 0.7071068]
    content["cameras"] = {"right": camera}
    del content["altitude_km"]
    prefix = tmp_path / "map"
    arguments = ["--axes", "roll,yaw", "--altitude", "500", "--step", "15", "-o", str(prefix)]
    assert main([str(written(tmp_path, content)), *arguments]) == 0
    rows = rows_of(prefix.with_suffix(".csv"))
    seen_at = {row["roll_deg"] for row in rows if row["in_field"]}
    # The horizon is 22 deg below level, the frame reaches 18 up and down: seen from 4 to 40.
    assert seen_at == {15.0, 30.0}
    lengths = [row["right_arc_px"] for row in rows if row["roll_deg"] == 15.0]
    assert np.ptp(lengths) < 5.0


def test_figure_6_has_its_maxima_on_the_diagonal(tmp_path, capsys):
    prefix = tmp_path / "figure6"
    assert main(["--figure6", "--step", "2", "-o", str(prefix)]) == 0
    assert "the diagonal: 19.62, +-36.87" in capsys.readouterr().out
    rows = rows_of(prefix.with_suffix(".csv"))
    for column in ("camera_1_arc_px", "section_circle_arc_px"):
        for side in (-1, 1):
            best = max(
                (row for row in rows if row["pitch_deg"] * side > 0), key=lambda r: r[column]
            )
            assert best["yaw_deg"] == pytest.approx(19.62, abs=2)
            assert best["pitch_deg"] * side == pytest.approx(36.87, abs=2)
    difference = [
        row["section_circle_arc_px"] - row["camera_1_arc_px"]
        for row in rows
        if row["camera_1_arc_px"] > 0
    ]
    assert 0.2 < np.sqrt(np.mean(np.square(difference))) < 2.0
    assert prefix.with_suffix(".png").stat().st_size > 50_000


def test_figure_6_needs_a_wide_horizon(tmp_path, capsys):
    assert np.isnan(diagonal_maximum_deg(paper_rig().views[0].camera, np.radians(20.0))[0])
    arguments = ["--figure6", "--altitude", "20000", "-o", str(tmp_path / "figure6")]
    assert main(arguments) == 2
    assert "take a lower altitude" in capsys.readouterr().err


def test_a_map_spans_its_cells_whatever_is_marked_on_it():
    grid = AngleGrid("yaw", "pitch", np.arange(0.0, 11.0, 2.0), np.arange(-4.0, 5.0, 4.0))
    values = np.arange(18.0)
    panel = Panel("", values, "px", marks_deg=[(50.0, 50.0)], outline=values > 5, label="far")
    axes = Figure().add_subplot()
    draw_panel(axes, grid, panel)
    assert axes.get_xlim() == (-1.0, 11.0)
    assert axes.get_ylim() == (-6.0, 6.0)
    drawn = axes.collections[0].get_array()
    np.testing.assert_array_equal(np.ravel(drawn), values)
    assert axes.collections[0].get_clim() == (0.0, 17.0)


def test_maps_with_nothing_in_them(tmp_path, capsys, recwarn):
    here = ["--range", "-90", "-80", "--y-range", "70", "80", "--step", "5"]
    assert main([str(EXAMPLE), *here, "--error", "arc", "-o", str(tmp_path / "map")]) == 0
    assert "at 0.0 % of 9 attitudes; no answer by arc anywhere" in capsys.readouterr().out
    assert main(["--figure6", *here, "-o", str(tmp_path / "figure6")]) == 0
    assert "no horizon in the frame" in capsys.readouterr().out
    assert not recwarn.list


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda c: c.pop("cameras"), "cameras: is missing"),
        (lambda c: c.update(cameras=[]), "cameras: must hold one block for each camera"),
        (lambda c: c["cameras"].update(camera_1=3), "cameras.camera_1: must be a block of keys"),
        (
            lambda c: c["cameras"]["camera_1"].pop("rotation"),
            "cameras.camera_1.rotation: is missing",
        ),
        (lambda c: c["cameras"]["camera_1"].pop("width"), "cameras.camera_1.width: is missing"),
        (lambda c: c["cameras"]["camera_1"].update(width=640.5), "must be whole pixels"),
        (lambda c: c["cameras"]["camera_1"].update(height="480 px"), "height: must be a number"),
        (
            lambda c: c["cameras"]["camera_1"].update(rotation=[0, 0, 1]),
            "must be a list of 4 numbers",
        ),
        (lambda c: c["cameras"]["camera_1"].update(rotation=[0, 0, 1, 1]), "must have length 1"),
        (lambda c: c["cameras"]["camera_1"].update(rotations=[0, 0, 0, 1]), "mean rotation?"),
        (lambda c: c["cameras"]["camera_1"].update(fx=700), "give either fx"),
        (lambda c: c["cameras"]["camera_1"].pop("fov_deg"), "give either fx"),
        (
            lambda c: c["cameras"]["camera_1"].update(fov_deg=180),
            "fov_deg: must be a number above 0",
        ),
        (lambda c: c["cameras"]["camera_1"].update(model="fisheye"), "model: must be one of"),
        (lambda c: c["cameras"]["camera_1"].update(distortion=[0.1]), "takes 0 or 4 or 5"),
        (lambda c: c.update(altitude_km=-1), "altitude_km: must be a number above 0"),
        (lambda c: c.update(altitude_km=True), "altitude_km: must be a number above 0"),
        (lambda c: c.update(nadir_at_zero=[0, 0, 0]), "nadir_at_zero: must not be zero"),
        (
            lambda c: c.update(planet={"shape": "flat"}),
            "planet.shape: must be one of sphere, wgs84",
        ),
        (lambda c: c["planet"].update(shape="wgs84"), "planet.radius_km: belongs to a sphere"),
        (
            lambda c: c["planet"].update(radius_km=float("nan")),
            "planet.radius_km: must be a number",
        ),
        (lambda c: c.pop("altitude_km"), "has no altitude_km; add it, or give --altitude KM"),
    ],
)
def test_errors_name_file_key_and_cure(tmp_path, capsys, content, spoil, message):
    spoil(content)
    path = written(tmp_path, content)
    assert main([str(path), "--step", "30", "-o", str(tmp_path / "map")]) == 1
    error = capsys.readouterr().err
    assert error.startswith(f"horizon_applicability: error: {path}: ")
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "map.png").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("cameras: [", "is not valid YAML"),
        ("just words", "must be a block of keys"),
        ("", "block"),
        ("cameras: " + 5000 * "[", "nested too deeply"),
        ("cameras: !!bool foo", "not of its kind"),
        ("altitude_km: !!int ''", "not of its kind"),
        ("altitude_km: 2024-13-45", "month"),
        ("altitude_km: 1" + 400 * "0", "too many digits"),
    ],
)
def test_files_that_are_no_mapping(tmp_path, text, message):
    with pytest.raises(CameraFileError, match=message):
        read_camera_file(written(tmp_path, text))


def test_yaml_runs_no_code(tmp_path):
    path = written(tmp_path, "cameras: !!python/object/apply:os.getcwd []")
    with pytest.raises(CameraFileError, match="not valid YAML"):
        read_camera_file(path)


@pytest.mark.parametrize(
    "text",
    ["[" * 5000, "altitude_km: !!bool foo", "altitude_km: 2024-13-45"],
)
def test_odd_yaml_is_refused_in_one_line(tmp_path, text):
    path = tmp_path / "cameras.yaml"
    path.write_text(text)
    with pytest.raises(CameraFileError, match="not valid YAML") as caught:
        read_camera_file(path)
    assert str(path) in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_a_number_larger_than_any_is_none(tmp_path, content):
    content["altitude_km"] = 10**400
    with pytest.raises(CameraFileError, match="too many digits"):
        read_camera_file(written(tmp_path, content))


def test_a_file_that_is_not_there_or_no_text(tmp_path):
    with pytest.raises(CameraFileError, match="cannot be read"):
        read_camera_file(tmp_path / "none.yaml")
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(CameraFileError, match="UTF-8"):
        read_camera_file(binary)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--step", "0"], "--step must be positive"),
        (["--step", "inf"], "--step must be positive, and finite"),
        (["--step", "0.001"], "take a wider step"),
        (["--step", "1e-12"], "take a wider step"),
        (["--step", "1e-320"], "take a wider step"),
        (["--range", "10", "-10"], "--range must rise"),
        (["--y-range", "0", "400"], "--y-range must rise"),
        (["--cameras", "left"], "it has camera_1, camera_2"),
        (["--error", "bound", "--sigma", "-1"], "--sigma must be positive"),
        (["--error", "arc", "--trials", "-1"], "--trials must be positive"),
        (["--altitude", "-5"], "--altitude must be above the limb"),
    ],
)
def test_wrong_options(tmp_path, capsys, options, message):
    assert main([str(EXAMPLE), "-o", str(tmp_path / "map"), *options]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--trials", "5"], "--trials has no effect without --error METHOD"),
        (["--trials", "5", "--error", "bound"], "--trials has no effect without --error METHOD"),
        (["--sigma", "0.1"], "--sigma has no effect without --error bound"),
        (["--sigma", "0.1", "--error", "arc"], "--error METHOD with --trials"),
        (["-o", ""], "argument -o/--output: must end in a name, to which .png and .csv are added"),
        (["-o", "maps/"], "must end in a name, to which .png and .csv are added, got 'maps/'"),
        (["-o", ".."], "must end in a name"),
    ],
)
def test_options_that_cannot_be_or_do_nothing(capsys, options, message):
    with pytest.raises(SystemExit) as stop:
        main([str(EXAMPLE), *options])
    assert stop.value.code == 2
    assert message in capsys.readouterr().err


def test_files_that_cannot_be_read_or_written_are_no_usage_error(tmp_path, capsys):
    assert main([str(tmp_path / "none.yaml")]) == 1
    assert "none.yaml" in capsys.readouterr().err
    (tmp_path / "map.csv").mkdir()
    assert main([str(EXAMPLE), "-o", str(tmp_path / "map")]) == 1
    told = capsys.readouterr().err
    # Before the work, not after it.
    assert told == (
        f"horizon_applicability: error: cannot write {tmp_path / 'map.csv'}: it is a folder; "
        "choose another place with -o PREFIX\n"
    )


@pytest.mark.parametrize(
    "options", [[], ["--figure6", "--error", "ml"], [str(EXAMPLE), "--axes", "yaw,yaw"]]
)
def test_wrong_usage_ends_with_code_2(capsys, options):
    with pytest.raises(SystemExit) as stop:
        main(options)
    assert stop.value.code == 2
    assert "error" in capsys.readouterr().err


def test_files_that_cannot_be_written_are_named_and_not_left_in_part(tmp_path, capsys):
    prefix = tmp_path / "map"
    with no_larger_files(10_000):
        assert main([str(EXAMPLE), "--step", "20", "-o", str(prefix)]) != 0
    told = capsys.readouterr().err
    assert f"cannot write {prefix}.png and {prefix}.csv: File too large; choose another" in told
    assert not list(tmp_path.iterdir())


def test_help_has_an_example(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--help"])
    assert stop.value.code == 0
    assert "horizon_applicability config/applicability_example.yaml" in capsys.readouterr().out


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("moment", ["while it loads", "while it computes"])
def test_interrupted_it_says_so(tmp_path, how, moment):
    prefix = tmp_path / "map"
    arguments = [str(EXAMPLE), "--step", "0.5", "--error", "ml", "-o", str(prefix)]
    process = subprocess.Popen(
        [sys.executable, "-m", "horizon_sensor_ros.tools.applicability.applicability", *arguments],
        stderr=subprocess.PIPE,
        text=True,
        bufsize=0,
    )
    if moment == "while it loads":
        # As soon as it takes care of signals at all.
        while not catches(process.pid, signal.SIGTERM):
            assert process.poll() is None
    else:
        bar = process.stderr.read(20)
        assert "field" in bar or "error" in bar
    process.send_signal(how)
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 130
    assert errors.replace("\r", "\n").splitlines()[-1] == "horizon_applicability: interrupted"
    assert "Traceback" not in errors
    assert not list(tmp_path.iterdir())


def catches(pid: int, number: int) -> bool:
    """Whether a process has a handler of a signal."""
    text = Path(f"/proc/{pid}/status").read_text()
    (line,) = [line for line in text.splitlines() if line.startswith("SigCgt")]
    return bool(int(line.split()[1], 16) >> (number - 1) & 1)
