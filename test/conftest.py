"""Fixtures that several tests share."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, settings

from horizon_sensor_ros.tools.private_domain import isolated_environment, private_domain

if TYPE_CHECKING:
    from craft import Chaser, Craft
    from node_processes import Program

ROOT = Path(__file__).parents[1]

# Before anything loads numpy, as in the package's own executables.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# As after an installation: without bytecode half of what a node takes to start is its compilation,
# and hundreds of processes are started here.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# A run in a shell's background is born deaf to SIGINT, and so would be all that it starts.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# How fast the machine is at the moment is no property of the code. Nor is which examples were
# drawn: one tree passes or fails, and `make test-explore` looks where these have not been.
settings.register_profile(
    "repeatable",
    derandomize=True,
    deadline=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile("explore", settings.get_profile("repeatable"), derandomize=False)
settings.load_profile("repeatable")


@pytest.fixture
def modules_of_the_benchmark(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a test import the benchmark's modules, which are in no package."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Directory of the shared scenes and photographs, which are not part of the repository."""
    directory = Path(os.environ.get("HORIZON_SHARED_DATA", ROOT.parent / "shared" / "data"))
    if not directory.is_dir():
        pytest.skip(f"the shared scenes are not here ({directory}); set HORIZON_SHARED_DATA")
    return directory


@pytest.fixture(scope="module")
def ros_domain() -> Iterator[int]:
    """ROS_DOMAIN_ID that no other tests on this machine use; set for this process as well.

    Its own for each module: nodes that one has killed stay in the graph for some 20 s.
    """
    with private_domain() as domain, pytest.MonkeyPatch.context() as patch:
        environment = isolated_environment(domain)
        for name in set(os.environ) - set(environment):
            patch.delenv(name)
        for name, value in environment.items():
            patch.setenv(name, value)
        yield domain


@pytest.fixture
def ros_environment(ros_domain: int) -> dict[str, str]:
    """Environment for a process with a node in it: private domain, this machine only."""
    return isolated_environment(ros_domain)


@pytest.fixture(scope="module")
def environment(ros_domain: int) -> Iterator[dict[str, str]]:
    """Environment of the nodes' processes: isolated. This process alone, which publishes the
    images, has the shipped transport: each user of it takes 64 MB of shared memory.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(ros_domain))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        environment = dict(os.environ)
        patch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(ROOT / "config" / "fastdds.xml"))
        yield environment


@pytest.fixture
def start(environment: dict[str, str]) -> Iterator[Callable[..., Program]]:
    """Start a named executable, with ROS arguments, in a process that ends with the test."""
    # Not above: it loads ROS, which most tests do without.
    from node_processes import Program

    programs: list[Program] = []

    def start_one(name: str, *arguments: str, **how: Any) -> Program:
        programs.append(Program(name, environment, *arguments, **how))
        return programs[-1]

    yield start_one
    for program in programs:
        program.make_end()


@pytest.fixture
def craft(ros_domain: int) -> Iterator[Craft]:
    """Two camera drivers, and somebody who listens to the nodes of the horizon."""
    from craft import Craft

    craft = Craft(ros_domain)
    yield craft
    craft.close()


@pytest.fixture
def chaser(ros_domain: int) -> Iterator[Chaser]:
    """A range camera's driver, and somebody who listens to the target's node."""
    from craft import Chaser

    chaser = Chaser(ros_domain)
    yield chaser
    chaser.close()
