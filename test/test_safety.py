"""Nothing that comes from outside is run, and nothing is read without a bound."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
from horizon_messages import recording, write_bag
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from horizon_sensor_ros.tools.bags import input_bag
from horizon_sensor_ros.tools.command_errors import CommandError

ROOT = Path(__file__).parents[1]
SOURCES = sorted(
    path
    for folder in ("horizon_sensor_ros", "benchmarks", "launch", "doc")
    for path in (ROOT / folder).rglob("*.py")
)
# Names that turn data into code, in any module.
CALLS = {
    *("eval", "exec", "compile", "__import__", "pickle", "cPickle", "marshal", "shelve", "dill"),
    *("os.system", "os.popen", "yaml.load", "yaml.load_all", "yaml.unsafe_load", "yaml.full_load"),
    *("yaml.Loader", "yaml.UnsafeLoader", "yaml.FullLoader", "joblib.load", "tempfile.mktemp"),
}


def dotted(node: ast.expr) -> str:
    if isinstance(node, ast.Attribute):
        return f"{dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else "?"


def dangers(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [alias.name for alias in node.names]
            module = getattr(node, "module", None)
            yield from ({*names, module or "", *(f"{module}.{n}" for n in names)} & CALLS)
        elif isinstance(node, ast.Attribute | ast.Name) and dotted(node) in CALLS:
            yield dotted(node)
        elif isinstance(node, ast.Call):
            for keyword in node.keywords:
                value = getattr(keyword.value, "value", None)
                if value is True and keyword.arg in ("shell", "allow_pickle"):
                    yield f"{keyword.arg}=True"


def test_no_data_is_ever_run() -> None:
    assert len(SOURCES) > 100
    found = {
        f"{path.relative_to(ROOT)}: {danger}"
        for path in SOURCES
        for danger in dangers(ast.parse(path.read_text()))
    }
    assert found == set()


@pytest.mark.parametrize(
    "source",
    [
        "eval(text)",
        "import pickle",
        "from pickle import loads",
        "yaml.load(text)",
        "np.load(path, allow_pickle=True)",
        "subprocess.run(line, shell=True)",
    ],
)
def test_the_check_finds_what_it_is_for(source: str) -> None:
    assert list(dangers(ast.parse(source)))


def test_a_bag_that_swells_when_it_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "bag"
    kind, zeros = "std_msgs/msg/String", bytes(300_000_000)
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection(
            "/bomb", kind, typestore=get_typestore(Stores.ROS2_JAZZY)
        )
        writer.write(connection, 1, zeros)
    (file,) = path.glob("*.mcap*")
    assert file.stat().st_size < 100_000
    monkeypatch.setattr(input_bag, "_MAX_BYTES", 100_000_000)

    def read(path: Path) -> int:
        bag = input_bag.open_bag(path)
        return len(list(bag.messages(bag.connections)))

    with pytest.raises(CommandError, match=r"truncated or damaged|cannot be read"):
        read(path)
    # And this process has its memory back.
    assert read(write_bag(tmp_path / "good", recording(1))) == 4
