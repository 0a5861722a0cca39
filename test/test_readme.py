"""The README's commands, word for word: those that can run here are run."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from horizon_messages import nadir_of, recording, write_bag, write_parameters

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.mathematics.attitude import rotation_from_quaternion
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.ros.parameters.file import read_parameter_file
from horizon_sensor_ros.ros.parameters.horizon_settings import horizon_settings
from horizon_sensor_ros.tools.camera_file import read_camera_file

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PACKAGE = "horizon_sensor_ros"
PROGRAMS = (".venv/bin/", "make ", "git ", "cd ", "PIP_", "colcon ", "source ", "ros2 ")


def commands(heading: str = "") -> list[str]:
    """Commands of the indented blocks below a heading, or of all, without their comments."""
    text = README.split(f"\n## {heading}\n", 1)[1].split("\n## ", 1)[0] if heading else README
    block = "\n".join(line[4:] for line in text.splitlines() if line.startswith("    "))
    lines = block.replace("\\\n", "").splitlines()
    return [re.split(r"\s{2,}#", line)[0].strip() for line in lines if line.startswith(PROGRAMS)]


def frame(view: CameraView, nadir_base: np.ndarray) -> np.ndarray:
    """An evenly lit planet, from 500 km."""
    height, width = view.camera.height, view.camera.width
    px = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2)
    cosine = view.camera.rays(px.astype(float)) @ view.rot_base_from_cam.T @ nadir_base
    inside = cosine.reshape(height, width) > np.cos(Planet().rho_from_altitude(500e3))
    noise = np.random.default_rng(0).normal(0.0, 1.0, inside.shape)
    return np.clip(cv2.GaussianBlur(5.0 + 175.0 * inside, (0, 0), 0.8) + noise, 0, 255).astype("u1")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone after `make demo`, with a folder of one's own images for each camera."""
    clone = tmp_path_factory.mktemp("clone")
    bin_directory = clone / ".venv" / "bin"
    bin_directory.mkdir(parents=True)
    for name in re.findall(r'"(horizon_\w+)": "tools\.([\w.]+)"', (ROOT / "setup.py").read_text()):
        script = bin_directory / name[0]
        script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m {PACKAGE}.tools.{name[1]} "$@"\n')
        script.chmod(0o755)
    shutil.copytree(ROOT / "config", clone / "config")
    (clone / "demo_output").mkdir()
    write_bag(clone / "demo_output" / "demo", recording(3))
    write_parameters(clone / "demo_output" / "params.yaml")
    rig = read_camera_file(clone / "config" / "two_cameras.yaml")
    for view, folder in zip(rig.views, ("left", "right"), strict=True):
        (clone / folder).mkdir()
        for index in range(2):
            cv2.imwrite(str(clone / folder / f"{index}.png"), frame(view, nadir_of(2.0, index)))
    return clone


def run(command: str, place: Path) -> str:
    """What a command of the README says; it has to work."""
    environment = dict(os.environ) | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        command, shell=True, cwd=place, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    return done.stdout + done.stderr


@pytest.fixture
def ignored(place: Path) -> Iterator[None]:
    """Holds a test to it that what its commands leave in the clone, git is told to ignore."""
    git = shutil.which("git")
    if git is None:
        yield
        return
    shutil.copy(ROOT / ".gitignore", place)
    for command in ("init --quiet", "add --all"):
        subprocess.run([git, *command.split()], cwd=place, check=True)
    yield
    new = subprocess.run(
        [git, "status", "--porcelain"], cwd=place, capture_output=True, text=True, check=True
    )
    assert [line for line in new.stdout.splitlines() if line.startswith("??")] == []


@pytest.mark.usefixtures("ignored")
def test_bags_and_images_as_the_readme_has_it(place: Path) -> None:
    said = [run(command, place) for command in commands("Bags")]
    assert len(said) == 5
    assert "3 fixes" in said[0]
    assert (place / "report.html").stat().st_size > 10_000
    assert "rows of /attitude" in said[2]
    assert (place / "tables" / "attitude.csv").read_text().count("\n") == 4
    assert "2 frames of camera_1, 2 frames of camera_2" in said[3]
    assert "2 fixes" in said[4]


@pytest.mark.usefixtures("ignored")
def test_where_to_mount_the_cameras(place: Path) -> None:
    (command,) = commands("Where to mount the cameras")
    assert run(command, place).count("best ") == 1
    assert (place / "mounting.png").is_file()


def test_every_command_is_one_of_those_looked_at() -> None:
    kinds = {
        ".venv/bin/": ("horizon_", "python benchmarks/"),
        "make ": ("demo", "test", "docs"),
    }
    for command in commands():
        for program, known in kinds.items():
            if command.startswith(program):
                assert command.removeprefix(program).startswith(known), command
    for target in (c.split()[1] for c in commands() if c.startswith("make ")):
        # As make itself reads it; what the targets do is tested elsewhere and by CI.
        run(f"make --dry-run PYTHON={sys.executable} {target}", ROOT)


def test_into_a_workspace(tmp_path: Path) -> None:
    lines = commands("With an installed ROS 2 Jazzy")
    assert [line.split()[0] for line in lines] == [
        *("git", "cd", "PIP_BREAK_SYSTEM_PACKAGES=1", "colcon", "source", "ros2", "ros2"),
    ]
    assert lines[2].split()[1:3] == ["rosdep", "install"]
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("not a clone")
    # What a fresh user's shell does, as far as there is no ROS: the clone, and where files lie.
    home = f'HOME="{tmp_path}"; '
    run(f"{home}{lines[0]}", ROOT)
    for line in lines[5:]:
        for word in re.findall(r"src/\S+", line):
            assert (tmp_path / "ws" / word).is_file(), line
    run_line, launch_line = (line.split() for line in lines[5:])
    assert f'"{run_line[3]}"' in (ROOT / "setup.py").read_text()
    assert (ROOT / "launch" / launch_line[3]).is_file()
    file = tmp_path / "ws" / run_line[-1]
    settings = horizon_settings(read_parameter_file(file, run_line[3], "/"))
    assert settings.pipeline.cameras == ("camera_1", "camera_2")


def test_the_parameter_file_shown_is_the_one_that_is_there() -> None:
    shown = README.split("This is `config/my_cameras.yaml`:\n\n", 1)[1]
    lines = [line[4:] for line in shown.split("\n\n", 1)[0].splitlines()]
    assert lines == (ROOT / "config" / "my_cameras.yaml").read_text().splitlines()


def test_the_two_example_files_have_the_same_mounting() -> None:
    rig = read_camera_file(ROOT / "config" / "two_cameras.yaml")
    values = read_parameter_file(ROOT / "config" / "my_cameras.yaml", "attitude_node", "/")
    rotations = horizon_settings(values).pipeline.rotations
    for view, quaternion in zip(rig.views, rotations, strict=True):
        assert quaternion is not None
        rot = rotation_from_quaternion(np.array(quaternion))
        np.testing.assert_allclose(view.rot_base_from_cam, rot, atol=1e-9)


def test_files_that_the_readme_links_to_exist() -> None:
    for link in re.findall(r"\]\(([^)#:]+)\)", README):
        assert (ROOT / link).exists(), link
