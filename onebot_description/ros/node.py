"""Runs nodes, with arguments, signals and errors; and common parts: QoS, description, warnings."""

from __future__ import annotations

import argparse
import functools
import math
import os
import re
import signal
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple, ParamSpec

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidParameterTypeException, NameValidationException
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer
from std_msgs.msg import String

from onebot_description.description import Description, load_description, parse_description
from onebot_description.description.packages import cache_folder, use_environment_prefix
from onebot_description.errors import OneBotError, shortened
from onebot_description.ros.discovery import configure_discovery, node_name, question, server
from onebot_description.ros.message_age import WAKE
from onebot_description.ros.parameters.reader import help_text
from onebot_description.ros.signals import StopSignals

P = ParamSpec("P")
MakeNode = Callable[[], Node | Sequence[Node]]
InvalidHandle = rclpy_implementation.InvalidHandle
RCLError = rclpy_implementation.RCLError

# QoS of topics whose last message late subscribers receive, too, such as robot_description.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

# Without a timeout, the events executor would spin at full CPU load; with one it sleeps.
_A_YEAR = 365.0 * 24 * 3600  # seconds
_TAKE_MISSED = 1.0  # seconds between looking for new subscriptions
_DESCRIPTION = "robot_description"  # name of the topic and of the parameter
_LONGEST = 4000  # characters of a throttled warning: it may name what a message holds
_PATIENCE = 2.0  # seconds without a description before a warning
_POLL_PUBLISHERS = 1.0  # seconds
_PLACE = re.compile(r", at \S+:\d+")  # a line of ROS's sources
# ROS's errors about a topic that the node has as another type, for a publisher and a subscription.
_TWO_TYPES = ("incompatible type", "subscription: invalid allocator")
# How long a second publisher must exist to be reported: a node may end while its successor starts,
# and a killed one stays in the graph for 20 s (the lease of Fast DDS).
_SETTLED, _FORGOTTEN = 3.0, 25.0  # seconds


def run_node(
    make_node: MakeNode,
    args: Sequence[str] | None = None,
    *,
    events: bool = False,
    whole_graph: bool = False,
) -> int:
    """Run a node, or several in one process, until Ctrl-C, SIGTERM or an error of one.

    Args:
        make_node: builds the node or nodes; rclpy is initialised by then. It, any callback of a
            node (see ``ends_node``), and its ``destroy_node`` may raise OneBotError, which ends
            the process with one line on stderr.
        args: arguments as in sys.argv (with ``--ros-args``); None for sys.argv itself.
        events: spin on rclpy's events executor, which takes a quarter of the time per message.
        whole_graph: the node looks at others' topics (see ``configure_discovery``).

    Returns:
        The exit code: 0 when stopped by a signal, 1 for a user's mistake.
    """
    use_environment_prefix()
    use_writable_log_folder()
    configure_discovery(whole_graph=whole_graph)
    stop: Future = Future()
    with StopSignals(lambda: _finish(stop), WAKE.resumed) as signals:
        try:
            rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        except Exception as error:  # rclpy raises several kinds, none of them public
            return _fail(f"bad ROS arguments: {first_line(error)}")
        _stops.append(stop)
        try:
            return _spin(make_node, stop, signals, events)
        finally:
            _stops.remove(stop)
            rclpy.try_shutdown()


def _spin(make_node: MakeNode, stop: Future, signals: StopSignals, events: bool) -> int:
    nodes: Sequence[Node] = ()
    executor: Executor | None = None
    try:
        with ros_errors():
            try:
                with signals.interrupting():
                    built = make_node()
                nodes = [built] if isinstance(built, Node) else built
                executor = _make_executor(events)
                for node in nodes:
                    executor.add_node(node)
                    if events:
                        MissedMessages(node)
                spin_until(stop, executor)
            finally:
                _destroy(nodes, executor)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except OneBotError as error:
        return _fail(str(error))
    return 0


def _destroy(nodes: Sequence[Node], executor: Executor | None) -> None:
    for node in nodes:
        if executor is not None:
            executor.remove_node(node)
        node.destroy_node()
    if executor is not None:
        # It frees the entities of DDS, for which rmw_fastrtps takes time quadratic in their number:
        # seconds for 100 robots. All else is done, so SIGTERM may end the process meanwhile.
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        executor.shutdown()


def steady_timer(node: Node, seconds: float, callback: Callable[[], object]) -> Timer:
    """Create a timer on the steady clock, because ROS time may stand still."""
    return node.create_timer(seconds, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


def _make_executor(events: bool) -> Executor:
    if events:
        from rclpy.experimental.events_executor import EventsExecutor

        return EventsExecutor()
    return SingleThreadedExecutor()


class MissedMessages:
    """Takes messages that arrived while a latched subscription was added to the events executor.

    rmw_fastrtps first counts received messages, and then asks to be notified of more. A message
    that arrives in between waits for the next one, which on a latched topic may never come.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._new: set[Subscription] = set()
        self._done: set[Subscription] = set()
        steady_timer(node, _TAKE_MISSED, self._take_missed)

    def _take_missed(self) -> None:
        latched = DurabilityPolicy.TRANSIENT_LOCAL
        present = {s for s in self._node.subscriptions if s.qos_profile.durability == latched}
        due = self._new & present
        self._done = self._done & present | due
        self._new = present - self._done
        for subscription in due:
            with suppress(InvalidHandle), subscription.handle:
                handle, kind = subscription.handle, subscription.msg_type
                while message := handle.take_message(kind, subscription.raw):
                    subscription.callback(message[0])


def spin_until(stop: Future, executor: Executor) -> None:
    """Spin until ``stop`` is completed, from any thread; raise the exception that it may have."""
    if not isinstance(executor, SingleThreadedExecutor):
        executor.spin_until_future_complete(stop, _A_YEAR)
    else:
        # spin_until_future_complete would add a callback to the future with each message, and never
        # remove one.
        stop.add_done_callback(lambda _: executor.create_task(lambda: None))
        while not stop.done():
            executor.spin_once()
    if error := stop.exception():
        raise error


_stops: list[Future] = []  # completed when the nodes of this process have to stop


def ends_node(callback: Callable[P, None]) -> Callable[P, None]:
    """Wrap a node's callback so that a OneBotError in it ends the process with one line.

    Without this, the events executor would log the error with its traceback first.
    """

    @functools.wraps(callback)
    def call(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            callback(*args, **kwargs)
        except OneBotError as error:
            for stop in _stops:
                if not stop.done():
                    stop.set_exception(error)

    return call


def at_stop(function: Callable[[], object]) -> None:
    """Call a function, from another thread, as soon as the nodes of this process have to stop.

    On a busy machine, the executor may take long to return.
    """
    for stop in _stops:
        stop.add_done_callback(lambda _: function())


def _finish(stop: Future) -> None:
    if not stop.done():
        stop.set_result(None)


@contextmanager
def ros_errors() -> Iterator[None]:
    """Convert ROS's errors about names, types and topics with two types to OneBotErrors."""
    warnings.filterwarnings("ignore", "Failed to fini")  # of rclpy, about a node that failed
    try:
        yield
    except (RCLError, NameValidationException, InvalidParameterTypeException) as error:
        text = first_line(error)
        if any(words in text for words in _TWO_TYPES):
            text += "; a node has a topic as one type only: see its name, and remappings (-r)"
        raise OneBotError(text) from None


def first_line(error: BaseException) -> str:
    """Return the first line of an error of ROS, without the places in ROS's sources."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return _PLACE.sub("", lines[0]).rstrip(":") if lines else type(error).__name__


def run_described_node(
    name: str,
    explanation: str | None,
    parameters: type,
    make_node: Callable[[str | None, RosArguments], Node | Sequence[Node]],
    check_files: Callable[[Sequence[Path]], object] | None,
    args: Sequence[str] | None,
    *,
    default_file: Callable[[], Path] | None = None,
    events: bool = False,
) -> int:
    """Run a node whose command line is ``[FILE] [--ros-args ...]``; return the exit code.

    Args:
        name: the program's name, for --help.
        explanation: text of --help, the module's docstring.
        parameters: dataclass of the parameters, for --help.
        make_node: called with FILE, or None, and the command line's parameter files and names.
        check_files: called with the parameter files before rcl reads them, because rcl's errors
            name neither the line nor a remedy. None for no check.
        args: arguments as in sys.argv; None for sys.argv itself.
        default_file: returns the parameter file to use if the command line names none.
        events: see ``run_node``.
    """
    arguments = list(sys.argv if args is None else args)
    parser = argparse.ArgumentParser(
        prog=name,
        description=f"{explanation}\n{help_text(parameters)}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("description", nargs="?", metavar="FILE", help="URDF or xacro file")
    chosen = parser.parse_args(ros_arguments(arguments).others)
    try:
        if default_file is not None and not ros_arguments(arguments).files:
            # First, so that the command line overrides it.
            file = ["--ros-args", "--params-file", str(default_file()), "--"]
            arguments = [*arguments[:1], *file, *arguments[1:]]
        ros = ros_arguments(arguments)
        if check_files is not None:
            check_files(ros.files)
    except OneBotError as error:
        return _fail(str(error))
    return run_node(lambda: make_node(chosen.description, ros), arguments, events=events)


def _fail(message: str) -> int:
    """Print a user's mistake as one error; return the exit code."""
    print(f"error: {OneBotError(message)}", file=sys.stderr, flush=True)
    return 1


def use_writable_log_folder() -> None:
    """Make ROS log to the cache folder if there is no writable home, without which it fails."""
    if os.environ.get("ROS_LOG_DIR") or os.environ.get("ROS_HOME"):
        return
    home = os.environ.get("HOME")
    if home:
        with suppress(OSError):
            folder = Path(home, ".ros/log")
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK):
                return
    os.environ["ROS_LOG_DIR"] = str(cache_folder() / "log")


class RosArguments(NamedTuple):
    """Parts of a command line that rcl does not report: parameter files, and names set by -p."""

    files: tuple[Path, ...] = ()  # given by --params-file, in order
    names: tuple[tuple[str, str], ...] = ()  # of the parameters set by -p: (node or "", parameter)
    others: tuple[str, ...] = ()  # arguments that are not for ROS, without the program's name

    def joined(self, own: Sequence[str]) -> RosArguments:
        """Return these with a node's ``own`` ROS arguments added, which override them."""
        more = ros_arguments(["", *(ros_args(own) or ())])
        return self._replace(files=self.files + more.files, names=self.names + more.names)


def ros_arguments(arguments: Sequence[str]) -> RosArguments:
    """Find the parameter files and names in ``arguments``, which are as in sys.argv."""
    files: list[Path] = []
    names: list[tuple[str, str]] = []
    others: list[str] = []
    inside, words = False, iter(arguments[1:])
    for word in words:
        if word == "--ros-args":
            inside = True
        elif inside and word == "--":
            inside = False
        elif inside and word == "--params-file":
            files.extend(Path(name) for name in [next(words, "")] if name)
        elif inside and word in ("-p", "--param"):
            left, assigned, _ = next(words, "").partition(":=")
            node, _, name = left.rpartition(":")
            if assigned:
                names.append((node, name))
        elif not inside:
            others.append(word)
    return RosArguments(tuple(files), tuple(names), tuple(others))


def split_robots(arguments: Sequence[str]) -> tuple[list[str], list[list[str]]]:
    """Split the command line of nodes of several robots, which is as in sys.argv.

    Returns:
        The arguments of the process, and the ROS arguments of each robot's node: what follows each
        --robot, until --ros-args or the end.
    """
    common: list[str] = []
    robots: list[list[str]] = []
    target, inside = common, False
    for word in arguments:
        if word == "--ros-args":
            target, inside = common, True
        elif word == "--robot" and not inside:
            target = []
            robots.append(target)
            continue
        target.append(word)
    return common, robots


def ros_args(own: Sequence[str] | None) -> list[str] | None:
    """Return a node's ``own`` ROS arguments as rclpy takes them."""
    return None if own is None else ["--ros-args", *own]


def is_path(text: str) -> bool:
    """Return whether the value of robot_description is the path of a file, not the URDF."""
    return bool(text) and "<" not in text


def described_by(text: str) -> Description:
    """Load the description that the value of robot_description contains, or whose path it is."""
    return load_description(text) if is_path(text) else parse_description(text, _DESCRIPTION)


class DescriptionTopic:
    """A subscription to robot_description, with a warning when nothing is published."""

    def __init__(
        self, node: Node, received: Callable[[str], None], has_one: Callable[[], bool]
    ) -> None:
        """Subscribe.

        Args:
            node: the subscriber.
            received: called with each URDF.
            has_one: returns whether the node already has a usable description.
        """
        self._node, self._has_one = node, has_one
        node.create_subscription(
            String, _DESCRIPTION, lambda message: received(message.data), LATCHED
        )
        self._timer = steady_timer(node, _PATIENCE, self._warn_once)

    def _warn_once(self) -> None:
        self._timer.cancel()
        if not self._has_one():
            topic = self._node.resolve_topic_name(_DESCRIPTION)
            self._node.get_logger().warning(
                f"waiting for the robot description on {topic}; is robot_state_publisher running?"
            )


class DiscoveryServerCheck:
    """Warns if the discovery server finds no other node, and logs when it does."""

    def __init__(self, own: Sequence[Node]) -> None:
        """Check periodically, if there is a discovery server; ``own``: nodes of this process."""
        self._node, self._own, self._warned = own[0], len(own), False
        if server():
            self._timer = steady_timer(self._node, _PATIENCE, self._poll)

    def _poll(self) -> None:
        alone = len(self._node.get_node_names()) <= self._own
        if alone and not self._warned:
            self._warned = True
            self._node.get_logger().warning(f"no other node is discovered: {question()}")
        elif not alone:
            self._timer.cancel()
            if self._warned:
                self._node.get_logger().info("other nodes are discovered now")


def warn_of_two_robots(node: Node, *, own: bool) -> None:
    """Warn if robot_description has several publishers; ``own``: the node is one of them."""
    problem = (
        "two robots take turns in one. Stop one, or start one with namespace:=NAME, or apart from "
        "the other with domain_id:=N"
    )
    OnlyPublisher(node, _DESCRIPTION, problem, own=own)


class OnlyPublisher:
    """Warns once of each further publisher of a topic that should have one.

    It must exist for a while, so that a restarted node does not count as a second publisher.
    """

    def __init__(self, node: Node, topic: str, problem: str, *, own: bool) -> None:
        """Watch a ``topic``, whose name is relative to the node's namespace.

        ``problem`` names the consequence of several publishers, and how to fix it; ``own``: the
        node publishes the topic itself.
        """
        self._node, self._topic = node, node.resolve_topic_name(topic)
        self._problem = problem
        self._own = f"{node.get_namespace().rstrip('/')}/{node.get_name()}" if own else ""
        self._lasting = Lasting(_SETTLED if own else _FORGOTTEN)
        steady_timer(node, _POLL_PUBLISHERS, self._poll)

    def _poll(self) -> None:
        names = self._names() if self._node.count_publishers(self._topic) > 1 else []
        if not self._lasting.new(names, time.monotonic()):
            return
        rivals = ", ".join(names)
        text = f"also published by {rivals}" if self._own else f"published by {rivals} at once"
        self._node.get_logger().warning(f"{self._topic} is {text}: {self._problem}")

    def _names(self) -> list[str]:
        """Return the nodes that publish it; a name that several nodes have, several times."""
        ends = self._node.get_publishers_info_by_topic(self._topic)
        names = sorted(map(node_name, ends))
        if self._own in names:
            names.remove(self._own)
        return names


class Lasting:
    """Reports names once, after they have been present for ``patience`` seconds."""

    def __init__(self, patience: float) -> None:
        """Start without names."""
        self._patience = patience
        self._names: list[str] = []
        self._since = 0.0
        self._reported = True

    def new(self, names: Sequence[str], now: float) -> bool:
        """Return True once when these ``names`` have been present long enough; ``now`` in s."""
        if list(names) != self._names:
            self._names, self._since, self._reported = list(names), now, not names
        if self._reported or now - self._since < self._patience:
            return False
        self._reported = True
        return True


class Throttled:
    """Logs texts of one kind at most once in some seconds."""

    def __init__(self, log: Callable[[str], object], every: float = 5.0) -> None:
        """Log with ``log`` at most once in ``every`` seconds.

        ``log`` is a logger's ``warning``. For another severity, pass a lambda: rclpy allows only
        one severity per line of code, and all these texts are logged from the same line.
        """
        self._log, self._every = log, every
        self._logged_at: dict[str, float] = {}

    def __call__(self, kind: str, text: str, *, every: float | None = None) -> None:
        """Log ``text``, unless a text of its kind was logged within ``every`` seconds."""
        now = time.monotonic()
        wait = self._every if every is None else every
        if now - self._logged_at.get(kind, -math.inf) >= wait:
            self._logged_at[kind] = now
            self._log(shortened(text, _LONGEST))
