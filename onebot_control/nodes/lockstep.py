"""Runs ROS nodes of this process in lockstep with a Simulation, at any speed.

In each control cycle the robots' topics and transforms are published, by the same code as in
``velocity_controller``, with /clock and the measurements that are due. Then the nodes' callbacks
run until none is ready, including timers on simulated time. Their commands take effect in the next
cycle, and only then does the physics continue.
"""

import functools
import os
import re
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, suppress
from itertools import product
from typing import Annotated, Any, ClassVar, Generic, TypeVar
from unittest.mock import patch

import rclpy
import rclpy.clock
from builtin_interfaces.msg import Time
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import Executor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSCompatibility, qos_check_compatible
from rclpy.signals import SignalHandlerGuardCondition, SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rosgraph_msgs.msg import Clock

from onebot_control.controlled_robot import Snapshot
from onebot_control.conventions import DRIVE_CONTROLLER, MANAGER
from onebot_control.nodes.callback_watch import CallbackWatch
from onebot_control.nodes.control_parameters import ControlParameters
from onebot_control.nodes.stepped_executor import TF_TOPICS, SteppedExecutor, is_alive
from onebot_control.nodes.world_interface import WorldInterface
from onebot_control.runtime.control_loop import SteppedLoop
from onebot_control.runtime.pacing import Divider, wake_exactly
from onebot_control.runtime.sensing import Sensing
from onebot_control.simulation_core import SimulationCore
from onebot_description.errors import OneBotError, alike, listing
from onebot_description.parameters.arguments import checked_methods
from onebot_description.parameters.values import Rule
from onebot_description.robot_state_publisher import RobotStatePublisher
from onebot_description.ros.command_line import RosArguments
from onebot_description.ros.discovery import MAX_DOMAIN, configure_discovery, use_local_discovery
from onebot_description.ros.run_node import ros_errors
from onebot_description.ros.topic_qos import is_transient_local
from onebot_description.ros.wire.definition import type_name
from onebot_description.timing import NS_PER_S

S = TypeVar("S")  # the simulation
T = TypeVar("T")
RCLError = rclpy_implementation.RCLError

_POLLS = 4.0  # Hz in simulated time, rate of polls for publishers of commands and localizers
_PATIENCE = 10.0  # s of wall time to wait for latched messages
_Domain = Annotated[int, Rule(at_least=0, at_most=MAX_DOMAIN)]
_TOPIC = re.compile(r"(~/|/)?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)
_Topic = Annotated[str, Rule(pattern=_TOPIC, write="a topic name, such as /cmd_vel")]
_Remap = Annotated[Mapping[_Topic, _Topic], Rule(write='a dict such as {"cmd_vel": "/cmd_vel"}')]
_USE_SIM_TIME = Parameter("use_sim_time", value=True)
_NAV2_RULES = ("-r", "~/cmd_vel:=cmd_vel", "-r", "~/odom:=odom")
_OWN_TOPICS = {"/rosout", "/parameter_events"}  # topics of every node


@checked_methods(before=lambda self: self._require_open())
class Lockstep(AbstractContextManager["Lockstep[S]"], Generic[S]):
    """Runs nodes in lockstep with a simulation; ``Simulation.ros`` creates it.

    Nodes that use callbacks and timers on simulated time behave identically in each run. There are
    warnings about timers on wall time and separate executors; threads cannot be detected.

    All nodes are in one context. Within it, Fast DDS connects a publisher and a subscription, or a
    client and a service, before the function that creates the second one returns, so nothing
    depends on discovery. It delivers a message before ``publish`` returns, so no message is pending
    when no callback is ready. /clock is delivered by a call.

    Attributes:
        simulation: the simulation of the nodes.
    """

    _current: "ClassVar[Lockstep[Any] | None]" = None

    def __init__(
        self,
        simulation: S,
        core: SimulationCore,
        domain_id: _Domain | None,
        *,
        remap: _Remap,
        nav2_topics: bool,
        callback_timeout: Annotated[float, Rule(above=0.0, infinite=True)],
    ) -> None:
        """Create the nodes of the simulation's robots; see ``Simulation.ros`` for the arguments.

        rclpy's default context is initialized, with use_sim_time for all nodes, if necessary.
        """
        if Lockstep._current is not None:
            text = "the robots of another simulation in this process already use ROS topics"
            raise OneBotError(f"{text}; close it first, or put all robots into one simulation")
        self.simulation, self._core = simulation, core
        self._stamp = 0  # the last published one, ns
        self._clock = Clock()
        self._warned: set[Timer | Node] = set()
        self._interface: WorldInterface | None = None
        self._closing = ExitStack()
        try:
            self._start(domain_id, remap, nav2_topics, float(callback_timeout))
        except BaseException:
            self.close()
            raise

    def _start(
        self, domain_id: int | None, remap: Mapping[str, str], nav2: bool, timeout: float
    ) -> None:
        on_close, core, fleet = self._closing, self._core, self._core.fleet
        Lockstep._current = self
        on_close.callback(self._forget)
        is_own = self._initialize(domain_id, remap)
        self._context = rclpy.get_default_context()
        wake_exactly()  # otherwise each wait takes at least 50 us
        on_close.callback(wake_exactly, False)
        self._watch = CallbackWatch(timeout)
        on_close.callback(self._watch.close)
        self._executor = SteppedExecutor(self._context, self._watch)
        on_close.callback(self._executor.shutdown)
        self._robot_nodes: list[Node] = []
        on_close.callback(self._destroy_nodes)
        for name, robot in zip(core.names, fleet.robots, strict=True):
            node = Node(
                MANAGER if robot.drive is None else DRIVE_CONTROLLER,
                context=self._context,
                namespace=f"/{name}",
                use_global_arguments=is_own,
                cli_args=["--ros-args", *(_NAV2_RULES if nav2 else ())],
                parameter_overrides=[_USE_SIM_TIME],
            )
            self._robot_nodes.append(node)
        nodes = [*self._robot_nodes]
        common = {"sensor_noise": core.noise, "sensors": core.sensor_file}
        settings = [
            ControlParameters(node, RosArguments(), type(robot.config), {**values, **common})
            for node, robot, values in zip(nodes, fleet.robots, core.parameters, strict=True)
        ]
        interface = WorldInterface(nodes, settings, core.scene, simulated=True, seed=core.seed)
        for robot_interface, robot in zip(interface.robots, fleet.robots, strict=True):
            robot_interface.description = robot.description
        for row, robot_interface in enumerate(interface.robots):
            interface.check_frames(row, robot_interface.frames())
        interface.start(SteppedLoop(fleet, interface.publish), Sensing(core.sensors))
        self._poll_due = Divider(_POLLS, fleet.rate)
        self._robot_nodes += interface.controller_nodes
        for node in self._robot_nodes:
            self._follow_time(node)
            self._executor.add_node(node)
        self._interface = interface
        on_close.enter_context(self._hooks())
        core.publish = self._publish

    def _initialize(self, domain_id: int | None, remap: Mapping[str, str]) -> bool:
        """Initialize rclpy's default context; return false if it has been initialized already."""
        if rclpy.ok():
            domain, early = rclpy.get_default_context().get_domain_id(), "rclpy was initialized"
            if domain_id not in (None, domain):
                text = f"in domain {domain} before ros(), so domain_id cannot be {domain_id}"
                raise OneBotError(f"{early} {text}")
            if remap:
                text = 'so remap has no effect; write rclpy.init(args=["--ros-args", "-r", "a:=b"])'
                raise OneBotError(f"{early} before ros(), {text}")
            return False
        if domain_id is None:
            text = os.environ.get("ROS_DOMAIN_ID") or "0"
            if not text.isdecimal() or int(text) > MAX_DOMAIN:
                raise OneBotError(f"ROS_DOMAIN_ID={text}: write a number from 0 to {MAX_DOMAIN}")
        rules = [word for name, new in remap.items() for word in ("-r", f"{name}:={new}")]
        with patch.dict(os.environ), ros_errors():
            use_local_discovery()
            configure_discovery()
            os.environ.pop("RMW_FASTRTPS_PUBLICATION_MODE", None)  # it may deliver messages late
            rclpy.init(
                args=["--ros-args", "-p", "use_sim_time:=true", *rules],
                domain_id=domain_id,
                # Ctrl-C is a KeyboardInterrupt, and ``close`` shuts ROS down.
                signal_handler_options=SignalHandlerOptions.NO,
            )
        self._closing.callback(rclpy.try_shutdown)
        return True

    def add(self, *nodes: Node) -> None:
        """Put nodes in lockstep, and deliver the last latched messages to them.

        ``close`` destroys them.

        Args:
            nodes: nodes of rclpy's default context. If use_sim_time of a node is false, it is set,
                and its timers start now.

        Raises:
            OneBotError: a node cannot be in lockstep, or its QoS of a robot's topic is
                incompatible.
        """
        for node in nodes:
            self._check(node)
        for node in nodes:
            if node not in self._executor.nodes:
                self._follow_time(node)
                self._executor.add_node(node)
        if apart := sorted({*self._unconnected(nodes)}):
            raise OneBotError(f"not connected with the robot: {'; '.join(apart)}")
        self._settle()
        self._warn_of_silent_topics(nodes)

    def remove(self, *nodes: Node) -> None:
        """Take nodes out of lockstep, without destroying them: their callbacks no longer run.

        Raises:
            OneBotError: a node has not been added, or has already been removed.
        """
        for node in nodes:
            if node not in self._added:
                name = _named(node) if isinstance(node, Node) else repr(node)
                raise OneBotError(f"{name} is not in lockstep")
            self._executor.remove_node(node)

    def _publish(self, snapshots: Sequence[Snapshot], stamp: int) -> None:
        """Publish the start of a control cycle, and run the nodes' callbacks."""
        if not self._is_running():
            return
        assert self._interface is not None
        self._stamp = stamp
        self._clock.clock.sec, self._clock.clock.nanosec = divmod(stamp, NS_PER_S)
        for node in self._executor.nodes:
            node._time_source.clock_callback(self._clock)
        try:
            self._interface.publish(snapshots, stamp)
            if self._poll_due.due():
                self._interface.poll()
                # ``_settle`` awaits the latched messages of the poll's new subscriptions.
                self._executor.changed = self._executor.look_for_events = True
        except RCLError:
            if self._is_running():  # else a thread has just shut rclpy down
                raise
        self._settle()

    def _settle(self) -> None:
        """Run callbacks until none is ready; an exception in a callback is raised here.

        Publishers and subscriptions created by them are connected when this returns, and have
        received the last latched messages.
        """
        while True:
            self._executor.run_ready()
            if not self._executor.changed or not self._context.ok():
                return
            self._executor.changed = False
            self._warn_of_wall_timers()
            self._publish_links()
            self._await_latched()

    def close(self) -> None:
        """Destroy the nodes; the simulation continues without ROS."""
        self._closing.close()

    def __exit__(self, *_: object) -> None:
        self.close()

    def _require_open(self) -> None:
        self._core.require_open()
        if Lockstep._current is not self:
            raise OneBotError(
                "the simulation's nodes have been closed; call simulation.ros() again"
            )

    def _forget(self) -> None:
        self._core.publish = Lockstep._current = None

    def _destroy_nodes(self) -> None:
        for node in dict.fromkeys([*self._executor.nodes, *self._robot_nodes]):
            node.destroy_node()

    def _is_running(self) -> bool:
        """Return whether ROS runs; log once that it does not."""
        if self._context.ok():
            return True
        if (first := self._robot_nodes[0]) not in self._warned:
            self._warned.add(first)
            text = "rclpy was shut down: the simulation continues without its nodes and topics"
            first.get_logger().warning(text)
        return False

    @property
    def _added(self) -> list[Node]:
        return [node for node in self._executor.nodes if node not in self._robot_nodes]

    def _check(self, node: Node) -> None:
        """Check that a node can be in lockstep.

        Raises:
            OneBotError: it cannot; the text is the reason.
        """
        if not isinstance(node, Node):
            raise OneBotError(f"add needs nodes, such as rclpy.node.Node('name'), not {node!r}")
        if not self._context.ok() or node.context is not self._context:
            text = "is not in rclpy's default context of this simulation, so cannot be in lockstep"
            raise OneBotError(f"a node {text}; create it after ros(), without context=")
        if not is_alive(node.handle):
            raise OneBotError("a node that has been destroyed cannot be in lockstep")
        executor = node.executor
        if _only_listens(executor):
            executor.shutdown()  # the node's callbacks run here instead
        if executor not in (None, self._executor) and node in executor.get_nodes():
            text = f"runs in a separate {type(executor).__name__}, so cannot be in lockstep"
            raise OneBotError(f"{_named(node)} {text}; simulation.run runs its callbacks")

    def _follow_time(self, node: Node) -> None:
        """Set a node's time, and let it use simulated time."""
        if not node.get_parameter(_USE_SIM_TIME.name).value:
            [result] = node.set_parameters([_USE_SIM_TIME])
            if not result.successful:
                raise OneBotError(f"{_named(node)}: use_sim_time cannot be set: {result.reason}")
            # At the next change of time, a timer would count the wall time that it has waited.
            node._time_source.clock_callback(Clock(clock=Time(nanosec=1)))
            node._time_source.clock_callback(self._clock)
            for timer in node.timers:
                timer.reset()
            if node not in self._robot_nodes:
                text = "use_sim_time was false, as rclpy was initialized before ros(); it is true"
                node.get_logger().warning(f"{text} from now on, and timers start now")
        elif self._stamp:
            node._time_source.clock_callback(self._clock)

    def _unconnected(self, nodes: Sequence[Node]) -> Iterator[str]:
        """Yield the topics of robots and nodes with incompatible QoS, with the reason."""
        pair = self._robot_nodes, nodes
        for publishing, subscribed in (pair, pair[::-1]):
            for publisher, subscription in product(
                _publishers(publishing), _subscriptions(subscribed)
            ):
                if (topic := publisher.topic_name) == subscription.topic_name:
                    offered, requested = publisher.qos_profile, subscription.qos_profile
                    compatibility, reason = qos_check_compatible(offered, requested)
                    if compatibility == QoSCompatibility.ERROR:
                        yield f"{topic}: incompatible QoS: {reason.strip('; ')}"

    def _await_latched(self) -> None:
        """Wait until subscriptions have received the last messages from DDS threads."""
        for publisher in _publishers(self._executor.nodes):
            if is_transient_local(publisher.qos_profile) and publisher.get_subscription_count():
                publisher.wait_for_all_acked(Duration(seconds=_PATIENCE))

    def _warn_of_silent_topics(self, nodes: Sequence[Node]) -> None:
        """Log topics without a publisher or a subscription, with the robots' most similar topic."""
        robots = self._robot_nodes
        for node in nodes:
            for ends, robot_ends, count, text in (
                (node.subscriptions, _publishers(robots), node.count_publishers, "publishes"),
                (node.publishers, _subscriptions(robots), node.count_subscribers, "subscribes to"),
            ):
                topics = {end.topic_name for end in robot_ends} - {"/clock", *_OWN_TOPICS}
                for topic in sorted({end.topic_name for end in ends} - _OWN_TOPICS):
                    if not count(topic):
                        guesses = [f'did you mean "{name}"? ' for name in alike(topic, topics)[:1]]
                        hint = f"({''.join(guesses)}the robot's: {listing(topics)})"
                        node.get_logger().warning(f"no node {text} {topic} {hint}")

    def _publish_links(self) -> None:
        """Publish the robots' links on TF once a node subscribes, unless another node does so."""
        added, first = self._added, self._executor.first
        publishers = {node for node in added if _describes(node)}
        if publishers - first:
            first |= publishers
            self._executor.wake()
        if first or all(end.topic_name not in TF_TOPICS for end in _subscriptions(added)):
            return
        assert self._interface is not None
        for robot in self._interface.robots:
            space = robot.node.get_namespace()
            prefix = robot.settings.config.prefixed("", space)
            words = ["-r", f"__ns:={space}", "-p", "hold_floating_joints:=false"]
            words += ["-p", f"frame_prefix:={prefix}"] if prefix else []
            node = RobotStatePublisher(robot.description, words)
            first.add(node)
            self._robot_nodes.append(node)
            self._follow_time(node)
            self._executor.add_node(node)

    def _warn_of_wall_timers(self) -> None:
        for node in self._added:
            for timer in node.timers:
                if timer in self._warned or getattr(timer.clock, "ros_time_is_active", False):
                    continue
                self._warned.add(timer)
                period, place = timer.timer_period_ns / NS_PER_S, _place(timer.callback)
                text = (
                    f"a timer of {period:g} s, {place}, is on wall time, so it is not in lockstep"
                )
                node.get_logger().warning(f"{text}; timers on the node's own clock are")

    # Hooks in rclpy ----------------------------------------------------------------------------

    def _hooks(self) -> ExitStack:
        """Return a context in which rclpy's nodes call this lockstep where necessary."""
        executor = Node.executor

        def set_executor(node: Node, new: Executor | None) -> None:
            if new is not None and _only_listens(new) and node in self._executor.nodes:
                new.remove_node(node)  # it has just added the node, whose callbacks run here
                return
            self._check_executor(node, new)
            executor.fset(node, new)

        stack = ExitStack()
        hooked = property(executor.fget, set_executor, doc=executor.__doc__)
        stack.enter_context(patch.object(Node, "executor", hooked))
        for name in ("create_publisher", "create_subscription"):
            stack.enter_context(patch.object(Node, name, self._agreeing(getattr(Node, name))))
        thread, sleep_until = threading.get_ident(), rclpy.clock.Clock.sleep_until
        begin_wait = SignalHandlerGuardCondition.__init__

        def sleep(clock: rclpy.clock.Clock, until: Any, context: Context | None = None) -> Any:
            on_simulated_time = getattr(clock, "ros_time_is_active", False)
            if on_simulated_time and threading.get_ident() == thread and until > clock.now():
                self._watch.refuse_to_sleep()
            return sleep_until(clock, until, context)

        def wait(guard: SignalHandlerGuardCondition, context: Context | None = None) -> None:
            begin_wait(guard, context)
            self._watch.foreign.add(guard)

        stack.enter_context(patch.object(rclpy.clock.Clock, "sleep_until", sleep))
        stack.enter_context(patch.object(SignalHandlerGuardCondition, "__init__", wait))
        return stack

    def _check_executor(self, node: Node, executor: Executor | None) -> None:
        """Reject another executor of a node in lockstep; log executors of other nodes."""
        if executor in (None, self._executor) or node.context is not self._context:
            return
        if _only_listens(executor):
            return
        kind = type(executor).__name__
        if node in self._executor.nodes:
            executor.remove_node(node)  # it has just added the node
            text = (
                f"{_named(node)} is in lockstep, so neither rclpy.spin... nor a {kind} can run it"
            )
            raise self._watch.fail(OneBotError(f"{text}; ros.remove(node) removes it"))
        self._watch.foreign.add(executor)
        if node not in self._warned:
            self._warned.add(node)
            text = f"{_named(node)} runs in a separate {kind}, so it is not in lockstep"
            node.get_logger().warning(f"{text}; ros.add(node) adds it")

    def _agreeing(self, create: Callable[..., T]) -> Callable[..., T]:
        """Return a method that creates a publisher or subscription with the robots' type."""

        @functools.wraps(create)
        def agreeing(node: Node, msg_type: Any, topic: str, *args: Any, **arguments: Any) -> T:
            name = kind = ""
            with suppress(Exception):  # ``create`` raises what is wrong
                name, kind = node.resolve_topic_name(topic), type_name(msg_type)
            self._agree(node, name, kind)
            return create(node, msg_type, topic, *args, **arguments)

        return agreeing

    def _agree(self, node: Node, topic: str, kind: str) -> None:
        """Let robots use the command type that a node is about to publish.

        Raises:
            OneBotError: a robot uses another type; a topic has only one type in a context.
        """
        if not (interface := self._interface) or node.context is not self._context:
            return
        if node in self._robot_nodes:
            return
        for robot in interface.robots:
            if (commands := robot.commands.subscription) is not None:
                commands.adopt(topic, kind)
        ends = (*_publishers(self._robot_nodes), *_subscriptions(self._robot_nodes))
        robot_types = {type_name(end.msg_type) for end in ends if end.topic_name == topic}
        for robot_type in robot_types - {kind}:
            text = f"{_named(node)} uses {topic} as {kind}, but the robot uses it as {robot_type}"
            raise OneBotError(f"{text}; in one process, a topic has one type")


def _publishers(nodes: Sequence[Node]) -> Iterator[Publisher]:
    return (publisher for node in nodes for publisher in node.publishers)


def _subscriptions(nodes: Sequence[Node]) -> Iterator[Subscription]:
    return (subscription for node in nodes for subscription in node.subscriptions)


def _named(node: Node) -> str:
    return f'node "{node.get_name()}"'


def _describes(node: Node) -> bool:
    """Return whether a node publishes a robot's description, like robot_state_publisher."""
    return any(end.topic_name.endswith("/robot_description") for end in node.publishers)


def _only_listens(executor: Any) -> bool:
    """Return whether an executor is the thread of a TransformListener, which lockstep replaces."""
    return getattr(executor, "only_listens", False)


def _place(function: Any) -> str:
    """Return a function's name, and where it is defined, if known."""
    name = getattr(function, "__qualname__", None) or repr(function)
    code = getattr(function, "__code__", None)
    return f"{name} ({code.co_filename}:{code.co_firstlineno})" if code else name
