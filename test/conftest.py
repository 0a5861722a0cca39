"""Fixtures that several tests share."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from horizon_sensor_ros.tools.private_domain import isolated_environment, private_domain

ROOT = Path(__file__).parents[1]

# Before anything loads numpy, as in the package's own executables.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Directory of the shared scenes and photographs, which are not part of the repository."""
    directory = Path(os.environ.get("HORIZON_SHARED_DATA", ROOT.parent / "shared" / "data"))
    if not directory.is_dir():
        pytest.skip(f"the shared scenes are not here ({directory}); set HORIZON_SHARED_DATA")
    return directory


@pytest.fixture(scope="session")
def ros_domain() -> Iterator[int]:
    """ROS_DOMAIN_ID that no other test run on this machine uses; set for this process as well."""
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
