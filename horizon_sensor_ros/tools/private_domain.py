"""A ROS domain of one's own on this machine, so that runs side by side do not hear each other."""

from __future__ import annotations

import fcntl
import os
import random
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

# Domains above 101 use UDP ports of Linux's ephemeral range; 0 is everybody's default.
_FIRST, _LAST = 1, 101


@contextmanager
def private_domain() -> Iterator[int]:
    """Hold a ROS_DOMAIN_ID that no other holder on this machine has, until the block ends.

    Held by a file lock, which goes with the process however it ends. Raises RuntimeError when all
    are taken.
    """
    directory = Path(tempfile.gettempdir()) / f"ros_domains_{os.getuid()}"
    directory.mkdir(exist_ok=True)
    for domain in random.sample(range(_FIRST, _LAST + 1), _LAST):
        with (directory / str(domain)).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain
            return
    raise RuntimeError(f"all ROS domains from {_FIRST} to {_LAST} are held, see {directory}")


def isolated_environment(domain: int) -> dict[str, str]:
    """Environment of this process, with ROS kept to `domain` and to this machine."""
    environment = dict(os.environ)
    environment["ROS_DOMAIN_ID"] = str(domain)
    environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    environment.pop("ROS_STATIC_PEERS", None)
    environment.pop("ROS_LOCALHOST_ONLY", None)
    return environment
