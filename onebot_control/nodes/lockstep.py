"""Runs ROS nodes of this process in step with a Simulation, whatever its speed.

In each control cycle the robots' topics and transforms are published, as ``velocity_controller``
publishes them and by the same code, with /clock and the measurements that are due. Then the nodes'
callbacks run until nothing is left to do, timers on simulated time included; their commands take
effect in the next cycle, and only then the physics moves on.
"""

import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from typing import Any, Generic, Protocol, TypeVar
from unittest.mock import patch

import rclpy
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor, TimeoutException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.task import Future

from onebot_control.controlled_robot import Snapshot
from onebot_control.controller_names import DRIVE_CONTROLLER, MANAGER
from onebot_control.fleet import Divider, Fleet
from onebot_control.nodes.control_loop import ControlLoop
from onebot_control.nodes.control_parameters import ControlParameters
from onebot_control.nodes.pacing import wake_exactly
from onebot_control.nodes.sensing import Sensing
from onebot_control.nodes.world_interface import WorldInterface
from onebot_control.sensing.sensors import Sensors
from onebot_description.description import Description
from onebot_description.errors import OneBotError, did_you_mean, listing
from onebot_description.ros.command_line import RosArguments
from onebot_description.ros.discovery import configure_discovery, use_local_discovery
from onebot_description.ros.topic_qos import is_transient_local
from onebot_description.ros.wake_detector import WakeDetector

T = TypeVar("T")

_POLLS = 4.0  # Hz, in simulated time, of polls for publishers of commands and localizers
_WAIT = 0.005  # s between checks whether topics are connected
_SIMULATED = ["--ros-args", "-p", "use_sim_time:=true"]
_PATIENCE = 10.0  # s to wait for topics to be connected


class _Simulation(Protocol):
    """What nodes in step need of their simulation; see ``Simulation``."""

    robots: Mapping[str, Any]
    _fleet: Fleet
    _noisy: bool
    _ros: Any
    _scene: Description | None
    _sensor_file: str
    _sensors: Sensors
    _values: list[dict[str, Any]]  # parameters of the robots' controllers

    @property
    def seed(self) -> int: ...


S = TypeVar("S", bound=_Simulation)


class Lockstep(AbstractContextManager["Lockstep[S]"], Generic[S]):
    """Runs nodes in step with a simulation; ``Simulation.ros`` creates it.

    Nodes that work by callbacks and by timers on simulated time behave identically in each run.
    Nothing is guaranteed for timers on wall time, and for threads or executors of their own.

    Attributes:
        simulation: the simulation that the nodes are in step with.
    """

    def __init__(self, simulation: S, domain_id: int | None = None) -> None:
        """Create the nodes of the simulation's robots.

        rclpy's default context is initialized, with use_sim_time for all nodes, unless it is
        already.

        Args:
            simulation: simulation of the robots.
            domain_id: the ROS domain; None for ROS_DOMAIN_ID.
        """
        self.simulation = simulation
        wake_exactly()  # otherwise each wait for nothing takes 50 us
        # The robots' nodes have a context of their own: in one context, a topic cannot have two
        # types, as ~/cmd_vel may have.
        self._context = Context()
        self._owns_default = not rclpy.ok()
        with patch.dict(os.environ):
            use_local_discovery()
            configure_discovery()
            if self._owns_default:
                rclpy.init(args=_SIMULATED, domain_id=domain_id)
            domain = rclpy.get_default_context().get_domain_id()
            rclpy.init(args=_SIMULATED, domain_id=domain, context=self._context)
        self._robots = EventsExecutor(context=self._context)  # it is cheaper by far
        self._executor = _Executor()
        self._arms = _Executor(context=self._context)  # actions need one
        self._added: list[Node] = []
        self._arm_nodes: list[Node] = []
        self._nodes = [
            Node(
                DRIVE_CONTROLLER if robot.has_wheels else MANAGER,
                context=self._context,
                namespace=f"/{name}",
            )
            for name, robot in simulation.robots.items()
        ]
        try:
            self._interface = self._start()
        except BaseException:
            self.close()
            raise

    def _start(self) -> WorldInterface:
        simulation, fleet = self.simulation, self.simulation._fleet
        common = {"sensor_noise": simulation._noisy, "sensors": simulation._sensor_file}
        settings = [
            ControlParameters(node, RosArguments(), {**values, **common})
            for node, values in zip(self._nodes, simulation._values, strict=True)
        ]
        interface = WorldInterface(
            self._nodes, settings, simulation._scene, simulated=True, seed=simulation.seed
        )
        for robot_interface, robot in zip(interface.robots, fleet.robots, strict=True):
            robot_interface.description = robot.description
        for row, robot_interface in enumerate(interface.robots):
            interface.check_frames(row, robot_interface.frames())
        interface.start(SteppedLoop(fleet, interface.publish), Sensing(simulation._sensors))
        self._poll_due = Divider(_POLLS, fleet.rate)
        for node in self._nodes:
            self._robots.add_node(node)
        self._arm_nodes = interface.arm_nodes
        for node in self._arm_nodes:
            self._arms.add_node(node)
        self._subscribed = set(self._topics_subscribed())
        return interface

    def add(self, *nodes: Node, timeout: float = _PATIENCE) -> None:
        """Put nodes in step, and wait until they are connected with the robots' topics.

        Afterwards they have also received the last messages of latched topics.

        ``close`` destroys them.

        Args:
            nodes: nodes of rclpy's default context; for timers, use_sim_time has to be true.
            timeout: wall time to wait, s.

        Raises:
            OneBotError: a topic that both a node and a robot have was not connected in time,
                because their types or QoS differ.
        """
        for node in nodes:
            self._executor.add_node(node)
            self._added.append(node)
        deadline = time.monotonic() + timeout
        while apart := sorted({*self._unconnected()}):
            if time.monotonic() > deadline:
                text = f"not connected with the robot in {timeout:g} s: {listing(apart)}"
                raise OneBotError(f"{text}; type or QoS differ, or DDS did not discover them")
            self._interface.poll()
            self.settle()
            time.sleep(_WAIT)
        # The last messages of latched topics are delivered by threads of DDS.
        for node in (*self._robot_nodes, *self._added):
            for publisher in node.publishers:
                if publisher.get_subscription_count() and is_transient_local(publisher.qos_profile):
                    left = max(0.0, deadline - time.monotonic())
                    publisher.wait_for_all_acked(Duration(seconds=left))
        self.settle()
        self._warn_of_silent_topics(nodes)

    def publish(self, snapshots: Sequence[Snapshot], stamp: int) -> None:
        """Publish a control cycle, and run the nodes' callbacks; ``Simulation.run`` calls it."""
        self._interface.publish(snapshots, stamp)
        if self._poll_due.due():
            self._interface.poll()
        self.settle()

    def settle(self) -> None:
        """Run callbacks until none is ready; an exception in a callback is raised here.

        Within a process, Fast DDS delivers a message before ``publish`` returns: if no node has a
        callback after the robots ran all of theirs, nothing is on its way.
        """
        executors = [executor for executor in (self._arms, self._executor) if executor.get_nodes()]
        for executor in executors:
            executor.take_time()
        while True:
            # Without a timeout it runs all that is ready.
            self._robots.spin_until_future_complete(Future(), 0.0)
            if not any([executor.run_ready() for executor in executors]):
                return

    def close(self) -> None:
        """Destroy the nodes; the simulation continues without ROS."""
        self.simulation._ros = None
        wake_exactly(False)
        self._executor.shutdown()
        self._arms.shutdown()
        for node in (*self._added, *self._arm_nodes):
            node.destroy_node()
        for node in self._nodes:
            self._robots.remove_node(node)
            node.destroy_node()
        self._robots.shutdown()
        rclpy.shutdown(context=self._context)
        if self._owns_default:
            rclpy.try_shutdown()

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def _robot_nodes(self) -> list[Node]:
        return [*self._nodes, *self._arm_nodes]

    def _warn_of_silent_topics(self, nodes: Sequence[Node]) -> None:
        """Log subscriptions without publishers, with the robots' most similar topic."""
        robots = [pub.topic_name for node in self._robot_nodes for pub in node.publishers]
        for node in nodes:
            for topic in sorted({sub.topic_name for sub in node.subscriptions}):
                if not node.count_publishers(topic):
                    hint = did_you_mean(topic, robots, "the robot's")
                    node.get_logger().warning(f"nobody publishes {topic}{hint}")

    def _topics_subscribed(self) -> Iterator[str]:
        return (sub.topic_name for node in self._robot_nodes for sub in node.subscriptions)

    def _unconnected(self) -> Iterator[str]:
        """Yield the topics on which a node and a robot are not yet connected in both directions."""
        # While ~/cmd_vel changes its type, no robot subscribes to it.
        changing = self._subscribed.difference(self._topics_subscribed())
        names = (pub.topic_name for node in self._added for pub in node.publishers)
        yield from changing.intersection(names)
        pair = self._robot_nodes, self._added
        for nodes, other_nodes in (pair, pair[::-1]):
            publishers = {pub.topic_name: pub for node in nodes for pub in node.publishers}
            subscriptions = [sub for node in other_nodes for sub in node.subscriptions]
            subscribers = Counter(sub.topic_name for sub in subscriptions)
            for subscription in subscriptions:
                topic = subscription.topic_name
                if (publisher := publishers.get(topic)) is None:
                    continue
                connected = publisher.get_subscription_count() >= subscribers[topic]
                if not (connected and subscription.get_publisher_count()):
                    yield topic


class _Executor(SingleThreadedExecutor):
    """Runs all callbacks that are ready."""

    def take_time(self) -> None:
        """Pass /clock on to the nodes' clocks, which takes ten times as long by a wait."""
        for node in self.get_nodes():
            if (clock := node._time_source._clock_sub) is not None:
                while message := clock.handle.take_message(clock.msg_type, False):
                    clock.callback(message[0])

    def run_ready(self) -> bool:
        """Run the callbacks that are ready now; return whether there were any.

        A coroutine that is suspended is resumed, but counts only when it ends: it may await what
        takes simulated time.
        """
        suspended, ran = [task for task, _, _ in self._tasks], False
        with suppress(TimeoutException):  # raised after the last one
            while True:
                handler, _, _ = self.wait_for_ready_callbacks(timeout_sec=0.0)
                handler()
                if (error := handler.exception()) is not None:
                    raise error
                ran |= handler.done() or handler not in suspended
        return ran


class SteppedLoop(ControlLoop):
    """A control loop without a thread, whose cycles ``Simulation.run`` runs."""

    def __init__(self, fleet: Fleet, publish: Callable[[Sequence[Snapshot], int], None]) -> None:
        """See ``ControlLoop``."""
        super().__init__(fleet, publish, simulated=True, wake=WakeDetector(lambda: 0.0))

    def start(self) -> None:
        """Do nothing: ``Simulation.run`` runs the cycles."""

    def post(self, function: Callable[[], object]) -> None:
        """Call ``function`` now: it is between two cycles."""
        function()

    def call(self, function: Callable[[], T]) -> T:
        """Call ``function`` now: it is between two cycles."""
        return function()

    def set_factor(self, factor: float) -> None:
        """Ignore the pace: a Simulation always runs as fast as possible."""

    def pause(self, paused: bool) -> None:
        """Refuse to pause, as ``step`` refuses to step."""
        if paused:
            self.step()

    def step(self, cycles: int = 1) -> None:
        """Refuse to step.

        Raises:
            OneBotError: always.
        """
        raise OneBotError("time passes in Simulation.run only")
