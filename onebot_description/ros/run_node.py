"""Runs the nodes of a process until a signal or an error, with their command line."""

from __future__ import annotations

import argparse
import functools
import gc
import os
import re
import signal
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import ParamSpec

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidParameterTypeException, NameValidationException
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer

from onebot_description.elements.packages import cache_folder, use_environment_prefix
from onebot_description.errors import OneBotError
from onebot_description.parameters.reader import help_text
from onebot_description.ros.command_line import RosArguments, ros_arguments
from onebot_description.ros.discovery import configure_discovery
from onebot_description.ros.signals import StopSignals
from onebot_description.timing.wake_detector import WAKE

P = ParamSpec("P")
MakeNode = Callable[[], Node | Sequence[Node]]
InvalidHandle = rclpy_implementation.InvalidHandle
RCLError = rclpy_implementation.RCLError

# Without a timeout, the events executor would spin at full CPU load; with one it sleeps.
_A_YEAR = 365.0 * 24 * 3600  # seconds
_TAKE_MISSED = 1.0  # seconds between looking for new subscriptions
_LONGEST_STOP = 3  # s until a process that hangs while it stops is ended
_PLACE = re.compile(r", at \S+:\d+")  # a line of ROS's sources
# ROS's errors if the node already has a topic with another type: for a publisher, a subscription.
_TWO_TYPES = ("incompatible type", "subscription: invalid allocator")


def run_node(
    make_node: MakeNode, args: Sequence[str] | None = None, *, whole_graph: bool = False
) -> int:
    """Run a node, or several in one process, until Ctrl-C, SIGTERM or an error.

    It spins on rclpy's events executor, which takes a quarter of the time per message.

    Args:
        make_node: creates the node or nodes, after rclpy is initialized. This function, callbacks
            of nodes (see ``ends_node``), and ``destroy_node`` may raise OneBotError, which ends
            the process with one line on stderr.
        args: arguments as in sys.argv (with ``--ros-args``); None for sys.argv itself.
        whole_graph: whether the node inspects all topics (see ``configure_discovery``).

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
        except Exception as error:  # rclpy raises several types, none of them public
            return _fail(f"bad ROS arguments: {first_line(error)}")
        _stops.append(stop)
        try:
            return _spin(make_node, stop, signals)
        finally:
            signal.alarm(0)
            _stops.remove(stop)
            rclpy.try_shutdown()


def _spin(make_node: MakeNode, stop: Future, signals: StopSignals) -> int:
    nodes: Sequence[Node] = ()
    executor: Executor | None = None
    try:
        with ros_errors():
            try:
                with signals.interrupting():
                    built = make_node()
                gc.enable()  # start_node disables it
                nodes = [built] if isinstance(built, Node) else built
                executor = EventsExecutor()
                for node in nodes:
                    executor.add_node(node)
                    MissedMessages(node)
                executor.spin_until_future_complete(stop, _A_YEAR)
                if error := stop.exception():
                    raise error
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
        # This frees the entities of DDS, for which rmw_fastrtps takes time quadratic in their
        # number, seconds for 100 robots. Everything else is done, so SIGTERM may end the process.
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.alarm(0)
        executor.shutdown()


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
    """Call a function, from another thread, as soon as the nodes of this process must stop.

    On a busy machine, the executor may take a long time to return.
    """
    for stop in _stops:
        stop.add_done_callback(lambda _: function())


def _finish(stop: Future) -> None:
    if not stop.done():
        # Fast DDS 2.14 may deadlock in a publisher while another process leaves, and Python with
        # it; then only a signal's default action ends the process.
        signal.alarm(_LONGEST_STOP)
        stop.set_result(None)


@contextmanager
def ros_errors() -> Iterator[None]:
    """Convert ROS's errors about names, types and topics with two types to OneBotErrors."""
    warnings.filterwarnings("ignore", "Failed to fini")  # rclpy's, about a node that failed
    try:
        yield
    except (RCLError, NameValidationException, InvalidParameterTypeException) as error:
        text = first_line(error)
        if any(words in text for words in _TWO_TYPES):
            text += (
                "; a node can use a topic with only one type: check its name and remappings (-r)"
            )
        raise OneBotError(text) from None


def first_line(error: BaseException) -> str:
    """Return the first line of an error of ROS, without places in ROS's sources."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return _PLACE.sub("", lines[0]).rstrip(":") if lines else type(error).__name__


def full_name(node: Node, name: str) -> str:
    """Return the full name that a topic or service has after remapping.

    Raises:
        OneBotError: it is not a valid name.
    """
    try:
        return str(node.resolve_topic_name(name))
    except Exception as error:  # rclpy raises several types, none of them public
        raise OneBotError(f'"{name}" is not a valid name: {first_line(error)}') from None


def run_described_node(
    name: str,
    explanation: str | None,
    parameters: type,
    make_node: Callable[[str | None, RosArguments], Node | Sequence[Node]],
    *,
    args: Sequence[str] | None,
    check_files: Callable[[Sequence[Path]], object] | None = None,
    default_file: Callable[[], Path] | None = None,
) -> int:
    """Run a node whose command line is ``[FILE] [--ros-args ...]``; return the exit code.

    Args:
        name: the program's name, for --help.
        explanation: text of --help, the module's docstring.
        parameters: dataclass of the parameters, for --help.
        make_node: called with FILE, or None, and the command line's parameter files and names.
        args: arguments as in sys.argv; None for sys.argv itself.
        check_files: called with the parameter files before rcl reads them, because rcl's errors
            name neither the line nor what to write. None for no check.
        default_file: returns the parameter file to use if the command line names none.
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
    return run_node(lambda: make_node(chosen.description, ros), arguments)


def _fail(message: str) -> int:
    """Print a user's mistake as one error; return the exit code."""
    print(f"error: {OneBotError(message)}", file=sys.stderr, flush=True)
    return 1


def use_writable_log_folder() -> None:
    """Make ROS log to the cache folder if there is no writable home; otherwise it would fail."""
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


def steady_timer(node: Node, seconds: float, callback: Callable[[], object]) -> Timer:
    """Create a timer on the steady clock, because ROS time may be paused."""
    return node.create_timer(seconds, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))
