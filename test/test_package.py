"""The package as colcon installs it, and its metadata."""

from __future__ import annotations

import json
import os
import py_compile
import re
import runpy
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[1]
PACKAGE = "horizon_sensor_ros"
COMMANDS = {
    "local_vertical_node",
    "attitude_node",
    "target_pose_node",
    "horizon_sensor",
    "horizon_replay",
    "horizon_self_calibration",
    "horizon_report",
    "horizon_applicability",
    "horizon_demo",
    "horizon_bag_from_images",
    "horizon_bag_to_csv",
}
NODES = ("local_vertical_node", "attitude_node", "target_pose_node")
EXTRINSICS = (
    "-p",
    "camera_1.rotation:=[0.5, 0.5, 0.5, 0.5]",
    "-p",
    "camera_2.rotation:=[0.0, 0.7071067811865476, 0.7071067811865476, 0.0]",
)


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Prefix of the package, built and installed by colcon."""
    work = tmp_path_factory.mktemp("colcon")
    build = subprocess.run(
        [
            *(sys.executable, "-m", "colcon", "--log-base", str(work / "log"), "build"),
            *("--paths", str(ROOT), "--packages-select", PACKAGE),
            *("--build-base", str(work / "build"), "--install-base", str(work / "install")),
        ],
        cwd=work,
        capture_output=True,
        text=True,
        check=False,
    )
    assert build.returncode == 0, build.stdout + build.stderr
    return work / "install" / PACKAGE


def in_workspace(installed: Path, *command: str) -> list[str]:
    """Command that runs in a shell with the workspace sourced, as a user would."""
    setup = installed.parent / "setup.bash"
    return ["bash", "-c", f'source "{setup}" && exec "$@"', "bash", *command]


def test_colcon_installs_executables_where_ros2_run_looks(installed: Path) -> None:
    executables = {p.name for p in (installed / "lib" / PACKAGE).iterdir() if os.access(p, os.X_OK)}
    assert executables >= COMMANDS


def test_colcon_installs_index_marker_and_share_files(installed: Path) -> None:
    share = installed / "share"
    assert (share / "ament_index" / "resource_index" / "packages" / PACKAGE).is_file()
    for name in ("package.xml", "README.md", "CHANGELOG.rst", "LICENSE"):
        assert (share / PACKAGE / name).read_bytes() == (ROOT / name).read_bytes()
    for folder, pattern in (
        *(("config", "*"), ("config/integration", "*"), ("config/security", "*")),
        *(("launch", "*.launch.py"), ("doc/pictures", "*")),
    ):
        ours = {p.name for p in (ROOT / folder).glob(pattern)}
        assert ours
        assert {p.name for p in (share / PACKAGE / folder).iterdir()} == ours


def test_pages_that_installed_files_refer_to_are_installed(installed: Path) -> None:
    share = installed / "share" / PACKAGE
    (site,) = installed.glob("lib/python3*/site-packages")
    files = [p for p in share.rglob("*") if p.suffix in {".yaml", ".xml", ".rviz", ".py", ".json"}]
    named: set[str] = set()
    for file in [*files, *(site / PACKAGE / "tools").rglob("*.py")]:
        named.update(re.findall(r"\bdoc/\w+\.md", file.read_text(encoding="utf-8")))
    assert {"doc/conventions.md", "doc/security.md"} <= named
    for page in named:
        assert (share / page).is_file(), page
    for page in [share / "README.md", *share.glob("doc/*.md")]:
        text = page.read_text(encoding="utf-8")
        assert "{toctree}" not in text, f"{page.name} is for Sphinx alone"
        # Pictures, other pages, and what a page takes in.
        links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)|^```\{include\} (\S+)$", text, re.M)
        for link in map("".join, links):
            assert (page.parent / link).is_file(), f"{page.name}: {link}"


def test_colcon_installs_every_module(installed: Path) -> None:
    (site,) = installed.glob("lib/python3*/site-packages")
    ours = {str(p.relative_to(ROOT)) for p in (ROOT / PACKAGE).rglob("*.py")}
    assert {str(p.relative_to(site)) for p in (site / PACKAGE).rglob("*.py")} == ours


@pytest.mark.parametrize("name", NODES)
def test_built_executable_becomes_active_and_ends_on_sigint(
    installed: Path, ros_environment: dict[str, str], ros_domain: int, name: str
) -> None:
    executable = str(installed / "lib" / PACKAGE / name)
    command = in_workspace(installed, executable, "--ros-args", *EXTRINSICS)
    with subprocess.Popen(
        command, env=ros_environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        try:
            assert lifecycle_state(name, ros_domain) == "active"
            process.send_signal(signal.SIGINT)
            output, _ = process.communicate(timeout=10)
        finally:
            process.kill()
    assert process.returncode == 0, output
    assert "Traceback" not in output


def lifecycle_state(node_name: str, domain: int, patience_s: float = 20.0) -> str:
    """State the node reports once it has come up; the last one heard when patience ends."""
    rclpy = pytest.importorskip("rclpy")
    from lifecycle_msgs.srv import GetState
    from rclpy.executors import SingleThreadedExecutor

    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    node = rclpy.create_node("package_test", context=context)
    try:
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        client = node.create_client(GetState, f"/{node_name}/get_state")
        deadline = time.monotonic() + patience_s
        state = "no answer"
        while state != "active" and time.monotonic() < deadline:
            if not client.wait_for_service(timeout_sec=1.0):
                continue
            answer = client.call_async(GetState.Request())
            executor.spin_until_future_complete(answer, timeout_sec=2.0)
            if answer.done():
                state = answer.result().current_state.label
        return state
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)


def test_built_executable_without_extrinsics_says_so_and_fails(
    installed: Path, ros_environment: dict[str, str]
) -> None:
    executable = str(installed / "lib" / PACKAGE / "attitude_node")
    done = subprocess.run(
        in_workspace(installed, executable),
        env=ros_environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode != 0
    assert "camera_1.rotation" in done.stderr
    assert "Traceback" not in done.stderr


def test_pip_installs_the_commands_beside_python() -> None:
    # `pip install --editable` reads setup.cfg too, and must not follow colcon's script directory.
    directory = Path(sys.executable).parent
    if not (directory / "activate").is_file():
        pytest.skip("not run from a virtual environment")
    assert {c for c in COMMANDS if os.access(directory / c, os.X_OK)} == COMMANDS


@pytest.fixture(scope="module")
def setup_arguments() -> dict[str, Any]:
    """What setup.py hands to setuptools, as colcon asks for it."""
    code = (
        "import json, setuptools; setuptools.setup = lambda **given: print(json.dumps(given)); "
        "import runpy; runpy.run_path('setup.py')"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


def test_manifest_and_setup_agree(setup_arguments: dict[str, Any]) -> None:
    manifest = ET.parse(ROOT / "package.xml").getroot()
    assert manifest.findtext("version") == setup_arguments["version"]
    assert manifest.findtext("license") == setup_arguments["license"]
    for role in ("maintainer", "author"):
        (person,) = manifest.iter(role)
        assert person.text == setup_arguments[role]
        assert person.get("email") == setup_arguments[f"{role}_email"]


def test_colcon_test_runs_pytest(setup_arguments: dict[str, Any]) -> None:
    # Where the extra does not name it colcon falls back to unittest, which finds no test here.
    extra = setup_arguments["extras_require"]["test"]
    assert "pytest" in extra
    manifest = ET.parse(ROOT / "package.xml").getroot()
    declared = {element.text for element in manifest.iter("test_depend")}
    assert {f"python3-{name}" for name in extra} <= declared


def test_every_ros_package_imported_is_declared() -> None:
    manifest = ET.parse(ROOT / "package.xml").getroot()
    declared = {element.text for element in manifest.iter("exec_depend")}
    pattern = re.compile(
        r"^\s*(?:from|import) (rclpy|tf2_ros|\w+_(?:msgs|interfaces|srvs))\b", re.M
    )
    source = "\n".join(path.read_text() for path in (ROOT / PACKAGE).rglob("*.py"))
    # The module tf2_ros is in the package tf2_ros_py.
    imported = {name.replace("tf2_ros", "tf2_ros_py") for name in pattern.findall(source)}
    assert {"rclpy", "tf2_ros_py"} <= imported
    assert imported <= declared


def launch_files() -> list[Path]:
    files = sorted((ROOT / "launch").glob("*.launch.py"))
    assert files
    return files


def test_launch_files_compile(tmp_path: Path) -> None:
    for path in launch_files():
        py_compile.compile(str(path), cfile=str(tmp_path / "launch.pyc"), doraise=True)


# What `ros2 launch` does with a file, without the command line tools.
_LAUNCH = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
source = PythonLaunchDescriptionSource(sys.argv[1])
arguments = [tuple(argument.split(":=")) for argument in sys.argv[2:]]
service = LaunchService()
included = IncludeLaunchDescription(source, launch_arguments=arguments)
service.include_launch_description(LaunchDescription([included]))
sys.exit(service.run())
"""


@pytest.mark.parametrize("name", [path.name for path in sorted(ROOT.glob("launch/*.launch.py"))])
def test_launch_files_bring_all_nodes_to_active(
    installed: Path,
    ros_environment: dict[str, str],
    ros_domain: int,
    tmp_path: Path,
    name: str,
) -> None:
    pytest.importorskip("launch_ros", reason="the launch system is not on PyPI, only in apt's ROS")
    params = tmp_path / "params.yaml"
    rotations = (text.split(":=") for text in EXTRINSICS if text != "-p")
    lines = ("/**:", "  ros__parameters:", *(f"    {key}: {value}" for key, value in rotations))
    params.write_text("\n".join(lines) + "\n")
    file = installed / "share" / PACKAGE / "launch" / name
    arguments = f"params_file:={params}", "namespace:=nav", "use_sim_time:=true"
    with subprocess.Popen(
        in_workspace(installed, sys.executable, "-c", _LAUNCH, str(file), *arguments),
        env=ros_environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            states = {node: lifecycle_state(f"nav/{node}", ros_domain) for node in NODES}
            # As Ctrl-C does: to the launch system and the nodes alike.
            os.killpg(process.pid, signal.SIGINT)
            output, _ = process.communicate(timeout=20)
        finally:
            process.kill()
    assert states == dict.fromkeys(NODES, "active"), output
    assert output.count("process has finished cleanly") == output.count("process started")
    assert "Traceback" not in output


class Made:
    """An object of the launch system: what it was made of."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self.arguments, self.options = arguments, options


@pytest.fixture
def described(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, list[Made]]]:
    """What each launch file describes, without the launch system, which is not on PyPI."""

    def kind(name: str) -> type:
        return type(name, (Made,), {})

    for module, kinds in {
        "launch": ("LaunchDescription",),
        "launch.actions": ("DeclareLaunchArgument",),
        "launch.conditions": ("IfCondition",),
        "launch.substitutions": ("LaunchConfiguration",),
        "launch_ros": (),
        "launch_ros.actions": ("Node",),
        "launch_ros.parameter_descriptions": ("ParameterValue",),
    }.items():
        instead = ModuleType(module)
        instead.__dict__.update({name: kind(name) for name in kinds})
        monkeypatch.setitem(sys.modules, module, instead)
    shared = f"{PACKAGE}.ros.process.launch_parts"
    monkeypatch.delitem(sys.modules, shared, raising=False)
    yield {
        path.name: runpy.run_path(str(path))["generate_launch_description"]().arguments[0]
        for path in launch_files()
    }
    sys.modules.pop(shared, None)


def of_kind(name: str, parts: list[Made]) -> list[Made]:
    return [part for part in parts if type(part).__name__ == name]


def test_launch_files_ask_for_the_parameters(described: dict[str, list[Made]]) -> None:
    for parts in described.values():
        arguments = {a.arguments: a.options for a in of_kind("DeclareLaunchArgument", parts)}
        assert {("namespace",), ("params_file",), ("use_sim_time",)} <= arguments.keys()
        # With any default of ours the nodes lack their rotations.
        asked = arguments["params_file",]
        assert list(asked) == ["description"]
        assert "extrinsics_source: tf" in asked["description"], "rotations may come from TF instead"


def test_launch_files_let_the_parameter_file_say_more_than_their_defaults(
    described: dict[str, list[Made]],
) -> None:
    # Of two sources for one parameter the later one counts.
    for parts in described.values():
        for node in of_kind("Node", parts):
            defaults, file = node.options["parameters"]
            assert list(defaults) == ["use_sim_time"]
            assert type(file).__name__ == "LaunchConfiguration"
            assert file.arguments == ("params_file",)


def test_launch_files_start_executables_that_are_there(described: dict[str, list[Made]]) -> None:
    started = {
        name: [node.options["executable"] for node in of_kind("Node", parts)]
        for name, parts in described.items()
    }
    assert started == {
        "horizon_sensor.launch.py": list(NODES),
        "horizon_sensor_one_process.launch.py": ["horizon_sensor"],
    }
    nodes = [node for parts in described.values() for node in of_kind("Node", parts)]
    assert {node.options["package"] for node in nodes} == {PACKAGE}


def test_only_launch_files_import_the_launch_system() -> None:
    pattern = re.compile(r"^\s*(?:from|import) (?:launch|\S*launch_parts\b)", re.M)
    files = [p for p in (ROOT / PACKAGE).rglob("*.py") if pattern.search(p.read_text())]
    assert [path.name for path in files] == ["launch_parts.py"]


def test_params_file_is_written_from_the_table_of_parameters() -> None:
    from horizon_sensor_ros.ros.parameters.reference import parameter_file

    written = (ROOT / "config" / "params.yaml").read_text()
    assert written == parameter_file(), "`make params` writes it anew"


def test_config_files_parse() -> None:
    parsers: dict[str, Callable[[str], Any]] = {
        **dict.fromkeys((".yaml", ".rviz"), yaml.safe_load),
        ".xml": lambda text: ET.fromstring(text) is not None,
        ".json": json.loads,
    }
    files = [path for path in (ROOT / "config").rglob("*") if path.is_file()]
    assert {path.parent.name for path in files} == {"config", "integration", "security"}
    for path in files:
        assert parsers[path.suffix](path.read_text(encoding="utf-8")), path


@pytest.mark.parametrize("node", ["horizon_node", "target_node"])
def test_nodes_start_without_the_slow_libraries(node: str) -> None:
    """A third of a second of start-up; the core imports them where they are needed."""
    slow = "{'scipy', 'matplotlib', 'rosbags'}"
    code = f"import sys, horizon_sensor_ros.ros.nodes.{node}; print({slow} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "set()", done.stderr
