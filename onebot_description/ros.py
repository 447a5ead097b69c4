"""What every node's ``main`` shares: start, spin, stop cleanly, and say one clear error."""

import os
import sys
from collections.abc import Callable, Sequence

import rclpy
from rclpy.exceptions import (
    InvalidParameterTypeException,
    ParameterUninitializedException,
)
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from onebot_description.ament import package_share, use_environment_prefix
from onebot_description.errors import OneBotError
from onebot_description.stop_signals import StopSignals

# The events executor hangs at a full core when it spins without a timeout; with one it sleeps.
_A_YEAR = 365.0 * 24 * 3600
_PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def use_quick_discovery() -> None:
    """Announce this process often; call it before rclpy is initialised.

    Fast DDS 2.14 announces a participant before it listens, so that about every other first answer
    is lost, and the next announcement is 3 s away. On this host alone, five small packets a second
    cost nothing. A wider discovery range, and a profile of the user's own, are left as they are.
    """
    if os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") != "LOCALHOST":
        return
    if not any(os.environ.get(name) for name in _PROFILES):
        profile = package_share("onebot_description") / "config/quick_discovery.xml"
        os.environ[_PROFILES[0]] = str(profile)


def run_node(
    make_node: Callable[[], Node], args: Sequence[str] | None = None, *, events: bool = False
) -> int:
    """Run one node until Ctrl-C, SIGTERM or its own error.

    Args:
        make_node: builds the node; rclpy is initialised by then. It, and any callback of the node,
            may raise OneBotError, which ends the process with one line on stderr.
        args: arguments as in sys.argv (with ``--ros-args``); None for sys.argv itself.
        events: spin on rclpy's events executor, about four times cheaper a message.

    Returns:
        The exit code: 0 when stopped by a signal, 1 for a user's mistake.
    """
    use_environment_prefix()
    use_quick_discovery()
    stop: Future = Future()
    with StopSignals(lambda: _finish(stop)) as signals:
        try:
            rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        except Exception as error:  # rclpy raises several kinds, none of them public
            return complain(f"bad ROS arguments: {_first_line(error)}")
        try:
            return _spin(make_node, stop, signals, events)
        finally:
            rclpy.try_shutdown()


def _spin(make_node: Callable[[], Node], stop: Future, signals: StopSignals, events: bool) -> int:
    node: Node | None = None
    executor: Executor | None = None
    try:
        with signals.interrupting():
            node = make_node()
        executor = _make_executor(events)
        executor.add_node(node)
        _spin_until(stop, executor)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except OneBotError as error:
        return complain(str(error))
    except InvalidParameterTypeException as error:
        return complain(_wrong_type(error))
    except ParameterUninitializedException as error:
        return complain(f"{error}; set it with -p name:=value or --params-file")
    finally:
        if executor is not None and node is not None:
            executor.remove_node(node)
        if node is not None:
            node.destroy_node()
        if executor is not None:
            executor.shutdown()
    return 0


def _make_executor(events: bool) -> Executor:
    if events:
        from rclpy.experimental.events_executor import EventsExecutor

        return EventsExecutor()
    return SingleThreadedExecutor()


def _spin_until(stop: Future, executor: Executor) -> None:
    if not isinstance(executor, SingleThreadedExecutor):
        executor.spin_until_future_complete(stop, _A_YEAR)
        return
    # That would hang one more callback on the future with each message, and never take one off.
    stop.add_done_callback(lambda _: executor.create_task(lambda: None))
    while not stop.done():
        executor.spin_once()


def _finish(stop: Future) -> None:
    if not stop.done():
        stop.set_result(None)


def _wrong_type(error: InvalidParameterTypeException) -> str:
    """Say what to write, because ROS parameters are strictly typed (10 is no double)."""
    text = str(error)
    remedy = "write the number with a decimal point, as in 10.0" if "DOUBLE" in text else ""
    return f"{text}; {remedy}" if remedy else text


def _first_line(error: BaseException) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0] if lines else type(error).__name__


def complain(message: str) -> int:
    """Print a user's mistake as one error; return the exit code for it."""
    print(f"error: {message}", file=sys.stderr, flush=True)
    return 1
