"""Nodes in processes of their own, and somebody who talks with them over real DDS."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter

from horizon_sensor_ros.ros.process.participant_end import on_one_core

PATIENCE_S, ANSWER_S = 20.0, 5.0
END_S = 5.0  # within which nodes end after a signal, as they promise
GOALS = {
    Transition.TRANSITION_CONFIGURE: State.PRIMARY_STATE_INACTIVE,
    Transition.TRANSITION_ACTIVATE: State.PRIMARY_STATE_ACTIVE,
    Transition.TRANSITION_DEACTIVATE: State.PRIMARY_STATE_INACTIVE,
    Transition.TRANSITION_CLEANUP: State.PRIMARY_STATE_UNCONFIGURED,
    Transition.TRANSITION_ACTIVE_SHUTDOWN: State.PRIMARY_STATE_FINALIZED,
}
# What rclpy says where the client had not been found yet: it asks once more (`Listener.ask`).
_ANSWER_LOST = re.compile(
    r"^.+: RuntimeWarning: failed to send response (?:to \S+ )?\(timeout\): .+\n(?:  .+\n)?", re.M
)
_STATE = re.compile(r"\[[A-Z]+\] \[[\d.]+\] \[[\w.]+\]: now [a-z_]+: ")


class Program:
    """An executable of the package in a process of its own.

    before : what comes before it on the command line, instead of its module. states : once it has
    ended, the lines that say what state a node is in; how many depends on how fast the machine is.
    """

    def __init__(
        self,
        name: str,
        environment: dict[str, str],
        *arguments: str,
        before: Sequence[str] = (),
    ) -> None:
        command = [sys.executable, *(before or ("-m", f"horizon_sensor_ros.ros.{name}"))]
        if arguments:
            command += ["--ros-args", *arguments]
        self.states: list[str] = []
        self.process = subprocess.Popen(
            command, env=environment, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def end(self, how: int = signal.SIGTERM) -> tuple[int, str]:
        """Signal the process, which then has `END_S`; exit code and what it wrote to stderr beside
        its nodes' states and answers that were lost.
        """
        self.process.send_signal(how)
        return self.wait(END_S)

    def wait(self, patience_s: float = PATIENCE_S) -> tuple[int, str]:
        _, errors = self.process.communicate(timeout=patience_s)
        lines = _ANSWER_LOST.sub("", errors).splitlines(keepends=True)
        self.states += [line for line in lines if _STATE.match(line)]
        return self.process.returncode, "".join(line for line in lines if not _STATE.match(line))

    def make_end(self) -> None:
        """End the process, politely first: killed, it leaves its shared memory behind."""
        if self.process.poll() is None:
            self.process.terminate()
        try:
            self.process.communicate(timeout=5.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.communicate()


class Listener:
    """A node of the tests': keeps what it hears, /diagnostics included."""

    def __init__(self, domain: int) -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node("craft", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.heard: list[tuple[str, Any]] = []
        self.listen(DiagnosticArray, "/diagnostics", 100)

    def listen(self, kind: type, topic: str, qos: Any) -> Any:
        return self.node.create_subscription(
            kind, topic, lambda msg: self.heard.append((topic, msg)), qos
        )

    def estimates(self, topic: str) -> list[Any]:
        return [msg for name, msg in self.heard if name == f"/{topic}"]

    def close(self) -> None:
        self.executor.shutdown()
        with on_one_core():
            self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def spin(self, duration_s: float) -> None:
        """Listen for a while."""
        end = time.monotonic() + duration_s
        while (left := end - time.monotonic()) > 0:
            self.executor.spin_once(timeout_sec=left)

    def wait(self, condition: Callable[[], Any], what: str) -> Any:
        deadline = time.monotonic() + PATIENCE_S
        while not (found := condition()):
            assert time.monotonic() < deadline, f"waited in vain for {what}"
            self.executor.spin_once(timeout_sec=0.02)
        return found

    def insist(self, send: Callable[[], None], node: str, words: str) -> None:
        """Send something again and again until a node says the words."""
        deadline = time.monotonic() + PATIENCE_S
        while not any(words in status.message for status in self.statuses(node)):
            assert time.monotonic() < deadline, f"waited in vain for {words!r}"
            send()
            self.spin(0.1)

    def hear_of_changes_only(self, node: str) -> None:
        """From now on what is heard of a node on /diagnostics is a change of its state.

        Not to be had from the start: the first changes may be lost, as any first message.
        """
        seldom = Parameter("diagnostics_period", value=1000.0).to_parameter_msg()
        request = SetParameters.Request(parameters=[seldom])
        assert self.call(SetParameters, f"/{node}/set_parameters", request).results[0].successful
        self.heard.clear()

    def statuses(self, node: str = "") -> list[Any]:
        return [
            msg.status[0]
            for name, msg in self.heard
            if name == "/diagnostics" and msg.status[0].name.startswith(node)
        ]

    def wait_for_state(self, state: str, words: str = "", node: str = "") -> Any:
        def said() -> Any:
            return [
                s for s in self.statuses(node) if s.values[0].value == state and words in s.message
            ]

        return self.wait(said, f"state {state!r} with {words!r}")[-1]

    def client_of(self, kind: type, name: str) -> Any:
        """A client that has found its service; None where it has not within a while, as discovery
        may lose one on a machine with much other work.
        """
        client = self.node.create_client(kind, name)
        deadline = time.monotonic() + ANSWER_S
        while not client.service_is_ready():
            if time.monotonic() > deadline:
                self.node.destroy_client(client)
                return None
            self.executor.spin_once(timeout_sec=0.02)
        return client

    def ask(self, kind: type, name: str, request: Any) -> Any:
        """What a service answers; None where nothing is heard of it, as a server drops its answer
        to a client that it has not found by then.
        """
        client = self.wait(lambda: self.client_of(kind, name), name)
        future = client.call_async(request)
        self.executor.spin_until_future_complete(future, timeout_sec=ANSWER_S)
        self.node.destroy_client(client)
        return future.result() if future.done() else None

    def call(self, kind: type, name: str, request: Any) -> Any:
        """The answer of a service that may be asked twice."""
        return self.wait(lambda: self.ask(kind, name, request), f"answer of {name}")

    def transition(self, node: str, transition: int) -> bool:
        """Whether a node makes a transition; its state tells where its answer was not heard."""
        request = ChangeState.Request(transition=Transition(id=transition))
        answer = self.ask(ChangeState, f"/{node}/change_state", request)
        return self.state(node) == GOALS[transition] if answer is None else answer.success

    def state(self, node: str) -> int:
        return self.call(GetState, f"/{node}/get_state", GetState.Request()).current_state.id
