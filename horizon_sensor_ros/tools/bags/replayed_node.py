"""The nodes' part in a replay: their pipelines' steps in bag time, their topics in a bag."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray

from horizon_sensor_ros.core.seconds import ns_from_s
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.ros.diagnostics.horizon_diagnostics import HorizonMonitor
from horizon_sensor_ros.ros.diagnostics.target_diagnostics import TargetMonitor
from horizon_sensor_ros.ros.parameters.horizon_settings import HorizonSettings
from horizon_sensor_ros.ros.parameters.target_settings import TargetSettings
from horizon_sensor_ros.ros.pipelines.horizon_outputs import HORIZON_OUTPUTS
from horizon_sensor_ros.ros.pipelines.horizon_pipeline import HorizonPipeline, Step
from horizon_sensor_ros.ros.pipelines.target_pipeline import (
    TARGET_TOPICS,
    TargetPipeline,
    TargetStep,
)
from horizon_sensor_ros.ros.process.node_names import full_name_of
from horizon_sensor_ros.tools.bags.output_bag import OutputBag
from horizon_sensor_ros.tools.command_errors import UsageError

_TOPIC = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)


class TopicNames:
    """Relative names to full ones, as the nodes' namespace and remappings make them.

    Raises UsageError for what is no namespace, or no remapping of a topic.
    """

    def __init__(self, namespace: str, remappings: Sequence[str]) -> None:
        self._namespace = "/" + namespace.strip("/")
        if self._namespace != "/" and not _TOPIC.fullmatch(self._namespace):
            raise UsageError(f"--namespace {namespace!r} is no namespace")
        self._remapped: dict[str, str] = {}
        self._asked: set[str] = set()
        for rule in remappings:
            source, found, target = rule.partition(":=")
            if not (found and source and target):
                raise UsageError(f"--remap must be FROM:=TO, got {rule!r}")
            if ":" in source or "~" in rule or source.startswith("__"):
                raise UsageError(
                    f"--remap {rule}: rules are for all nodes and for topics alone; leave out what "
                    "names a node (NODE:, ~ or __)"
                )
            for name in (source, target):
                if not _TOPIC.fullmatch(name):
                    raise UsageError(f"--remap {rule}: {name!r} is no name of a topic")
            # As rcl: of two rules for one name the first one counts.
            self._remapped.setdefault(self._full(source), self._full(target))

    def __call__(self, name: str) -> str:
        """Full name of a topic."""
        full = self._full(name)
        self._asked.add(full)
        return self._remapped.get(full, full)

    @property
    def idle_rules(self) -> list[str]:
        """Remappings of topics whose full name nobody has asked for."""
        rules = self._remapped.items()
        return [f"{source}:={target}" for source, target in rules if source not in self._asked]

    @property
    def merged(self) -> list[tuple[str, list[str]]]:
        """Topics that stand for several of the full names asked for, and these."""
        names: dict[str, list[str]] = {}
        for source in sorted(self._asked):
            names.setdefault(self._remapped.get(source, source), []).append(source)
        return [(topic, sources) for topic, sources in names.items() if len(sources) > 1]

    def of_node(self, name: str) -> str:
        """Full name of a node, which no rule renames."""
        return self._full(name)

    def before(self, topic: str) -> str | None:
        """Return what a topic's full name was before remapping; None when nobody means it."""
        for source, target in self._remapped.items():
            if target == topic:
                return source
        return None if topic in self._remapped else topic

    def _full(self, name: str) -> str:
        return name if name.startswith("/") else full_name_of(name, self._namespace)


class ReplayedNode:
    """What a node would publish; a subclass says what becomes of its input.

    settings, monitor : the node's. pipeline : what the monitor follows.
    """

    def __init__(
        self,
        settings: HorizonSettings | TargetSettings,
        monitor: HorizonMonitor | TargetMonitor,
        pipeline: Any,
        names: TopicNames,
        bag: OutputBag,
    ) -> None:
        self._pipeline = pipeline
        self._stale_after = settings.stale_after_ns
        self._bag = bag
        self._diagnostics = names("/diagnostics")
        self._monitor: Any = monitor
        self._period = ns_from_s(settings.diagnostics_period_s)
        self._due: int | None = None
        self._now = 0
        bag.add_topic(self._diagnostics, DiagnosticArray)

    def advance(self, time: int) -> None:
        """Let bag time go on to `time`; diagnostics that were due meanwhile are written."""
        if self._due is None:
            self._now = self._due = time
            self._diagnose()
        # Nothing changes in a long pause once every sensor has been reported silent.
        silent = self._now + self._stale_after + 2 * self._period
        while self._due <= time:
            if self._due > silent:
                self._due += (time - self._due) // self._period * self._period
            self._now = self._due
            self._diagnose()
        self._now = max(self._now, time)

    def on_step(self, step: Any) -> None:
        """Write what an input gave, and a change of state at once."""
        self._monitor.on_step(step, self._now)
        self.write_estimates(step)
        if self._monitor.changed(self._now):
            self._write_diagnostics()

    def finish(self) -> None:
        """Write the diagnostics of the end: the last counts were not due any more."""
        if self._due is not None:
            self._write_diagnostics()

    def words(self) -> str:
        """Return the state at the present bag time and its reason, for a person."""
        health = self._monitor.health(self._now)
        return f"{health.state}: {health.reason}"

    def write_estimates(self, step: Any) -> None:
        """Write the estimates of a pipeline's step."""
        raise NotImplementedError

    def write(self, topic: str, message: Any) -> None:
        """Write a message at the present bag time."""
        self._bag.write(topic, self._now, message)

    def _diagnose(self) -> None:
        assert self._due is not None
        self._due += self._period
        self._write_diagnostics()

    def _write_diagnostics(self) -> None:
        self.write(self._diagnostics, self._monitor.message(self._now, self._pipeline))


class ReplayedHorizonNode(ReplayedNode):
    """A node of the horizon."""

    def __init__(
        self,
        name: str,
        settings: HorizonSettings,
        pipeline: HorizonPipeline,
        names: TopicNames,
        bag: OutputBag,
    ) -> None:
        self._output = HORIZON_OUTPUTS[name]
        self._settings = settings
        self._topic = names(self._output.topic)
        monitor = HorizonMonitor(
            f"{name}: horizon",
            settings.pipeline.cameras,
            settings.stale_after_ns,
            live=False,
            node=names.of_node(name),
        )
        bag.add_topic(self._topic, self._output.message)
        super().__init__(settings, monitor, pipeline, names, bag)

    def write_estimates(self, step: Step) -> None:
        """Write what an image completed."""
        for result in step.results:
            if result.fix.status is Status.OK:
                self.write(self._topic, self._output.encode(result, self._settings))


class ReplayedTargetNode(ReplayedNode):
    """The target's node."""

    def __init__(
        self,
        name: str,
        settings: TargetSettings,
        pipeline: TargetPipeline,
        names: TopicNames,
        bag: OutputBag,
    ) -> None:
        self._topics = {topic: names(topic) for topic in TARGET_TOPICS}
        for topic, kind in TARGET_TOPICS.items():
            bag.add_topic(self._topics[topic], kind)
        monitor = TargetMonitor(
            f"{name}: target", settings.stale_after_ns, live=False, node=names.of_node(name)
        )
        super().__init__(settings, monitor, pipeline, names, bag)

    def write_estimates(self, step: TargetStep) -> None:
        """Write what a cloud gave."""
        for topic, message in step.outputs:
            self.write(self._topics[topic], message)
