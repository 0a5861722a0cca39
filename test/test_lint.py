"""Style and types, as part of the tests."""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]


def run_tool(*arguments: str) -> None:
    if find_spec(arguments[0]) is None:
        pytest.skip(f"{arguments[0]} is not installed: make venv installs it, rosdep does not")
    done = subprocess.run(
        [sys.executable, "-m", *arguments], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_ruff_finds_nothing() -> None:
    run_tool("ruff", "check", ".")


def test_what_a_user_writes_beside_the_code_is_no_module_of_ours(tmp_path: Path) -> None:
    (tmp_path / "pyproject.toml").write_text((ROOT / "pyproject.toml").read_text())
    # The folder that the README's horizon_bag_to_csv makes; the benchmarks have a module so named.
    (tmp_path / "tables").mkdir()
    imports = "import numpy as np\nimport tables\n\nimport horizon_sensor_ros\n"
    (tmp_path / "mine.py").write_text(f"{imports}\nprint(np, tables, horizon_sensor_ros)\n")
    run_tool("ruff", "check", "--select", "I", str(tmp_path))


@pytest.mark.skipif(
    np.lib.NumpyVersion(np.__version__) < "2.0.0",
    reason="types are checked against the stubs of NumPy 2: NumPy 1 has other ones",
)
def test_mypy_finds_nothing() -> None:
    run_tool("mypy")
