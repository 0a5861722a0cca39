"""A lifecycle node that takes its parameters from the table and can bring itself up."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Generic, TypeVar

from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter as RosParameter

from horizon_sensor_ros.ros.files.yaml_file import shown
from horizon_sensor_ros.ros.nodes.parameter_requests import refuse_values_of_no_type
from horizon_sensor_ros.ros.nodes.qos import check_overrides, misspelt_topics
from horizon_sensor_ros.ros.nodes.sim_time import refuse_times_before_1970
from horizon_sensor_ros.ros.parameters.ignored import ignored_parameters
from horizon_sensor_ros.ros.parameters.parameter import Parameter, ParameterError
from horizon_sensor_ros.ros.process.defect import words_of
from horizon_sensor_ros.ros.process.participant_end import on_one_core

Settings = TypeVar("Settings")

_KINDS = {
    "string": RosParameter.Type.STRING,
    "double": RosParameter.Type.DOUBLE,
    "integer": RosParameter.Type.INTEGER,
    "bool": RosParameter.Type.BOOL,
    "string_array": RosParameter.Type.STRING_ARRAY,
    "double_array": RosParameter.Type.DOUBLE_ARRAY,
}


class ManagedNode(LifecycleNode, Generic[Settings]):
    """Base of the nodes: parameters, lifecycle with clear failures, autostart.

    A subclass says what its parameters are and makes settings of them. It makes its resources in
    `open`, uses them between `start` and `stop`, and gives them back in `close`. Raises
    ParameterError when the node cannot run with its parameters.

    qos_overrides : the parameters of that name that were given, which rclpy declares only with the
    publishers and subscriptions they are for.
    """

    def __init__(self, name: str, **node_arguments: Any) -> None:
        try:
            super().__init__(
                name, automatically_declare_parameters_from_overrides=True, **node_arguments
            )
        except ValueError as error:
            # rclpy, to which an empty list is none, does not say which.
            raise ParameterError(
                f"a parameter was given an empty list: name its values or leave it out ({error})"
            ) from error
        self._failure = ""
        self._starting = False
        self._parameter_names: set[str] = set()
        self.qos_overrides: dict[str, Any] = {}
        try:
            self.settings = self._declare_parameters()
        except BaseException:
            self.destroy_node()
            raise
        for service in self.services:
            if service.srv_type is ChangeState:
                service.callback = partial(self._change_state, service.callback)
        refuse_values_of_no_type(self)
        refuse_times_before_1970(self)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._take_parameters)

    # What a subclass does.

    def parameters_of(self, values: Mapping[str, Any]) -> tuple[Parameter, ...]:
        """Return all parameters of a node to which these values were given."""
        raise NotImplementedError

    def settings_of(self, values: Mapping[str, Any]) -> Settings:
        """Return validated settings; ParameterError says what is wrong with the values."""
        raise NotImplementedError

    def open(self) -> None:
        """Make publishers and all that is used between `start` and `stop`."""
        raise NotImplementedError

    def start(self) -> None:
        """Begin to work."""
        raise NotImplementedError

    def stop(self) -> None:
        """Cease to work; also called when not working."""
        raise NotImplementedError

    def close(self) -> None:
        """Give back what `open` made; also called when there is nothing."""
        raise NotImplementedError

    def warm_up(self) -> None:
        """Do once what takes longer the first time; the node may be active already."""
        raise NotImplementedError

    def apply(self, settings: Settings) -> None:
        """Take settings that changed while the node runs."""
        raise NotImplementedError

    # Lifecycle.

    def bring_up(self) -> None:
        """Configure and activate, if `autostart` says so; ParameterError says why it cannot."""
        if not self.get_parameter("autostart").value:
            return
        self._starting = True
        for transition in (self.trigger_configure, self.trigger_activate):
            if transition() != TransitionCallbackReturn.SUCCESS:
                raise ParameterError(self._failure or "the node could not be activated")
        self._starting = False
        # Meanwhile the sensors' drivers discover the subscriptions.
        self.warm_up()

    def _change_state(
        self,
        change: Callable[[ChangeState.Request, ChangeState.Response], ChangeState.Response],
        request: ChangeState.Request,
        response: ChangeState.Response,
    ) -> ChangeState.Response:
        """Answer as rclpy does, but refuse a transition that the node's state does not have: rclpy
        raises its error, a RuntimeError, and so ends the process.
        """
        try:
            return change(request, response)
        except RuntimeError:
            asked = request.transition.label or f"number {request.transition.id}"
            state = self._state_machine.current_state[1]
            self.get_logger().warning(f"transition {asked} is refused: the node is {state}")
            response.success = False
            return response

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make the node's resources."""
        try:
            self.open()
            if not self.get_parameter("autostart").value:
                self.warm_up()
        except Exception as error:
            # rclpy would turn whatever it is into a silent failure.
            self.stop()
            self.close()
            return self._failure_of(error)
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to work."""
        activated = super().on_activate(state)
        try:
            self.start()
        except Exception as error:
            super().on_deactivate(state)
            # Still configured: what the node has made it keeps, for another attempt.
            self.stop()
            return self._failure_of(error)
        self._say_misspelt_topics()
        return activated

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Cease to work."""
        self.stop()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Give back the node's resources."""
        self.close()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Cease to work and give back the node's resources."""
        self.stop()
        self.close()
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start over, unconfigured, after a transition that broke."""
        self.stop()
        self.close()
        return super().on_error(state)

    def _failure_of(self, error: Exception) -> TransitionCallbackReturn:
        expected = isinstance(error, ParameterError)
        self._failure = str(error) if expected else words_of(error)
        # As it starts by itself the process ends, with these words.
        if not self._starting:
            self.get_logger().error(self._failure)
        return TransitionCallbackReturn.FAILURE

    def _say_misspelt_topics(self) -> None:
        # By now each publisher and subscription has declared its own.
        known = [f"qos_overrides.{name}" for name in self.get_parameters_by_prefix("qos_overrides")]
        for name, meant in misspelt_topics(self.qos_overrides, known).items():
            self.get_logger().warning(f"{name} is for no topic; did you mean {meant}?")

    def destroy_node(self) -> None:
        """Give back what the node has of the middleware, and leave the graph."""
        with on_one_core():
            super().destroy_node()
            # rclpy 7.1 leaves it, which keeps the node in the graph, to the garbage collector.
            self._state_machine.destroy_when_not_in_use()

    # Parameters.

    def _declare_parameters(self) -> Settings:
        # What was given was declared just as it was given; now it is declared as the table has it.
        declared: dict[str, Any] = self.get_parameters_by_prefix("")
        sim_time = declared.get("use_sim_time")
        if sim_time is not None and not isinstance(sim_time.value, bool):
            raise ParameterError(f"use_sim_time must be true or false, got {shown(sim_time.value)}")
        given = {
            name: parameter.value
            for name, parameter in declared.items()
            if name not in ("use_sim_time", "start_type_description_service")
        }
        for name in given:
            self.undeclare_parameter(name)
        for ignored in ignored_parameters(given, self.parameters_of(given)):
            self.get_logger().warning(ignored)
        self.qos_overrides = {n: v for n, v in given.items() if n.startswith("qos_overrides.")}
        check_overrides(self.qos_overrides)
        settings = self.settings_of(given)
        for parameter in self.parameters_of(given):
            value = given.get(parameter.name, parameter.default)
            if value is None:
                # Declared without a value, rclpy answers no request that it is among.
                continue
            self._parameter_names.add(parameter.name)
            accepted = parameter.accept(value)
            descriptor = descriptor_of(parameter)
            self.declare_parameter(parameter.name, accepted, descriptor, ignore_override=True)
        return settings

    def _values(self, changes: list[RosParameter]) -> dict[str, Any]:
        values = {p.name: p.value for p in self.get_parameters(list(self._parameter_names))}
        values.update({p.name: p.value for p in changes if p.name in values})
        return values

    def _concerned(self, changes: list[RosParameter]) -> bool:
        """Whether any is in the table; each topic's QoS overrides are parameters too."""
        return not self._parameter_names.isdisjoint(change.name for change in changes)

    def _check_parameters(self, changes: list[RosParameter]) -> SetParametersResult:
        if self._concerned(changes):
            try:
                self.settings_of(self._values(changes))
            except ParameterError as error:
                return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take_parameters(self, changes: list[RosParameter]) -> None:
        if not self._concerned(changes):
            return
        settings = self.settings_of(self._values([]))
        if settings != self.settings:
            self.settings = settings
            self.apply(settings)


def descriptor_of(parameter: Parameter) -> ParameterDescriptor:
    """Return what a node tells of a parameter."""
    unit = f" [{parameter.unit}]" if parameter.unit else ""
    descriptor = ParameterDescriptor(
        description=parameter.description + unit,
        additional_constraints=" | ".join(parameter.choices),
        read_only=not parameter.live,
        type=_KINDS[parameter.kind].value,
    )
    if parameter.minimum is not None and parameter.maximum is not None:
        if parameter.kind == "integer":
            limits = IntegerRange(
                from_value=int(parameter.minimum), to_value=int(parameter.maximum)
            )
            descriptor.integer_range = [limits]
        else:
            floats = FloatingPointRange(
                from_value=float(parameter.minimum), to_value=float(parameter.maximum)
            )
            descriptor.floating_point_range = [floats]
    return descriptor
