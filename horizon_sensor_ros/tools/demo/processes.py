"""The demo's nodes, each in its own process, and nothing left of them afterwards."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from horizon_sensor_ros.tools.demo.failures import NodeFailedError

# A node ends within a second or two; a machine with other work may keep it from that for a while.
_PATIENCE_S = 20.0
_LAST_WORDS_S = 2.0
_SHOWN_LINES = 25


@dataclass(frozen=True)
class NodeProcess:
    """A running node; everything it prints goes to `log`."""

    name: str
    process: subprocess.Popen[bytes]
    log: Path

    def last_words(self) -> str:
        """Last lines of the node's output."""
        lines = self.log.read_text(errors="replace").splitlines()
        return "\n".join(f"    {line}" for line in lines[-_SHOWN_LINES:]) or "    (it said nothing)"


def executable_path(name: str) -> Path:
    """Executable of a node: beside the running command (colcon, venv) or beside python, or on PATH.

    Raises NodeFailedError when there is none.
    """
    for directory in (Path(sys.argv[0]).resolve().parent, Path(sys.executable).parent):
        if (directory / name).is_file():
            return directory / name
    found = shutil.which(name)
    if found is None:
        raise NodeFailedError(f"there is no executable {name}: is the package installed?")
    return Path(found)


@contextmanager
def running_nodes(
    names: Sequence[str],
    arguments: Sequence[str],
    environment: Mapping[str, str],
    log_directory: Path,
) -> Iterator[tuple[NodeProcess, ...]]:
    """Start the nodes; end them however the block ends.

    Raises NodeFailedError when a node, after a block that went well, does not end well on SIGINT.
    """
    nodes: list[NodeProcess] = []
    try:
        for name in names:
            # Interrupted halfway through its start, a node would run on with nobody to end it.
            with _signals_held():
                nodes.append(_start(name, arguments, environment, log_directory / f"{name}.log"))
        yield tuple(nodes)
        require_alive(nodes)
        _interrupt(nodes)
        for node in nodes:
            _require_good_end(node)
    finally:
        try:
            _interrupt([node for node in nodes if node.process.poll() is None])
        finally:
            for node in nodes:
                node.process.kill()
                node.process.wait()


def require_alive(nodes: Sequence[NodeProcess]) -> None:
    """Raise NodeFailedError, with its last words, if one of the nodes has ended."""
    for node in nodes:
        code = node.process.poll()
        if code is not None:
            raise NodeFailedError(f"{node.name} ended with exit code {code}:\n{node.last_words()}")


def _require_good_end(node: NodeProcess) -> None:
    code = node.process.poll()
    if code == 0:
        return
    how = f"ended with exit code {code}"
    if code is None:
        how = f"still ran {_PATIENCE_S:g} s"
        # Python says where it is when it is aborted (the nodes' executor sees to that).
        node.process.send_signal(signal.SIGABRT)
        with suppress(subprocess.TimeoutExpired):
            node.process.wait(_LAST_WORDS_S)
    raise NodeFailedError(f"{node.name} {how} after SIGINT:\n{node.last_words()}")


@contextmanager
def _signals_held() -> Iterator[None]:
    """Put off signals that would end this process until the block is done."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    held: list[int] = []
    previous = [signal.signal(number, lambda n, _frame: held.append(n)) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, previous, strict=True):
            signal.signal(number, handler)
        for held_number in held:
            signal.raise_signal(held_number)


def _start(
    name: str, arguments: Sequence[str], environment: Mapping[str, str], log: Path
) -> NodeProcess:
    with log.open("wb") as output:
        process = subprocess.Popen(
            [str(executable_path(name)), *arguments],
            env=dict(environment),
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            # Ctrl-C is for the demo alone, which then ends its nodes in good order.
            start_new_session=True,
        )
    return NodeProcess(name, process, log)


def _interrupt(nodes: Sequence[NodeProcess]) -> None:
    for node in nodes:
        node.process.send_signal(signal.SIGINT)
    deadline = time.monotonic() + _PATIENCE_S
    for node in nodes:
        try:
            node.process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            continue
