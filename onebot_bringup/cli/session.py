"""A short-lived, hidden node for one command, with discovery.

There is no daemon, so other nodes have to be discovered first, which takes some tenths of a second.
A command waits until the entity that it needs is discovered; lists wait until the graph is stable.
"""

import argparse
import functools
import math
import os
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from onebot_bringup.introspection.interfaces import is_hidden
from onebot_description.elements.packages import use_environment_prefix
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.ros.discovery import (
    configure_discovery,
    question,
    server,
    use_local_discovery,
)
from onebot_description.ros.names import absolute, node_name
from onebot_description.ros.signals import KeyboardInterrupts

_QUIET = 0.5  # s without changes (over two announcements) after which discovery is complete
_MAX_DISCOVERY = 2.0  # s
_LOOKUP = 3.5  # s to discover a name, since participants announce themselves every 3 s
PATIENCE = 1.0  # s after which a waiting command prints what it waits for
_POLL = 0.02  # s


class Session:
    """A node and its executor, as a context manager.

    Ctrl-C, SIGTERM and a terminal that is closed raise KeyboardInterrupt within the context.
    """

    def __init__(self, ros_args: Sequence[str] = (), name: str | None = None) -> None:
        self._ros_args = ["--ros-args", *ros_args]
        self._name = name or f"_onebot_{os.getpid()}"  # a hidden node's name

    def __enter__(self) -> "Session":
        use_local_discovery()
        use_environment_prefix()
        # This imports rclpy, which takes long.
        from onebot_description.ros.run_node import ros_errors, use_writable_log_folder

        use_writable_log_folder()
        configure_discovery(whole_graph=True)
        self._errors = ros_errors()
        self._errors.__enter__()
        self.interrupts = KeyboardInterrupts().__enter__()
        if sys.stdout is not None and hasattr(sys.stdout, "reconfigure"):
            sys.stdout.reconfigure(line_buffering=True)  # write each line at once, even to a pipe
        self._start()
        return self

    def _start(self) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.signals import SignalHandlerOptions

        from onebot_description.ros.run_node import first_line

        try:
            rclpy.init(args=self._ros_args, signal_handler_options=SignalHandlerOptions.NO)
            self.node = rclpy.create_node(self._name, start_parameter_services=False)
        except Exception as error:  # rclpy raises several types, none of them public
            rclpy.try_shutdown()
            raise OneBotError(f"ROS does not start: {first_line(error)}") from None
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)

    def __exit__(self, *raised: Any) -> bool | None:
        import rclpy

        self.interrupts.__exit__()
        self._executor.shutdown(0.0)
        self.node.destroy_node()
        rclpy.try_shutdown()
        return self._errors.__exit__(*raised)

    def spin(self, until: Callable[[], Any], timeout: float | None = None) -> Any:
        """Run callbacks until ``until()`` is true, at most ``timeout`` (s); return its value."""
        deadline = None if timeout is None else time.monotonic() + timeout
        while True:
            value = until()
            if value:
                return value
            left = _POLL if deadline is None else min(_POLL, deadline - time.monotonic())
            if left <= 0.0:
                return value
            self._executor.spin_once(timeout_sec=left)

    def spin_until(self, moment: float) -> None:
        """Run callbacks until a time of the monotonic clock."""
        self.spin_for(moment - time.monotonic())

    def spin_for(self, seconds: float) -> None:
        """Run callbacks for some time."""
        self.spin(lambda: False, seconds)

    def discover(self) -> None:
        """Wait until discovery is complete: until nothing changes."""
        if not self.look_for(self._sees_other_nodes, "other nodes"):
            return
        graph, started = self._graph(), time.monotonic()
        now = changed = started
        while now - changed < _QUIET and now - started < _MAX_DISCOVERY:
            self.spin_for(_POLL)
            now, graph_now = time.monotonic(), self._graph()
            if graph_now != graph:
                graph, changed = graph_now, now

    def _sees_other_nodes(self) -> bool:
        return len(self.node.get_node_names()) > 1

    def _graph(self) -> Any:
        topics = self.node.get_topic_names_and_types()
        return sorted(self.node.get_node_names_and_namespaces()), [
            (name, types, self.node.count_publishers(name), self.node.count_subscribers(name))
            for name, types in topics
        ]

    @property
    def space(self) -> str:
        """The session's namespace, with a slash at its start; "" for the root."""
        return absolute(self.node.get_namespace())

    def full_name(self, name: str) -> str:
        """Return the absolute name of a topic or service, after remapping."""
        from onebot_description.ros.run_node import full_name

        return full_name(self.node, name)

    def topics(self, hidden: bool = False) -> list[tuple[str, list[str]]]:
        """Return names and types of all topics discovered so far."""
        return _visible(self.node.get_topic_names_and_types(), hidden)

    def published(self, kind: str, ending: str, within: str) -> list[str]:
        """Return the published topics of a type below a namespace whose names end so."""
        return [
            name
            for name, types in self.topics()
            if kind in types and name.startswith(f"{within}/") and name.endswith(ending)
            if self.node.count_publishers(name)
        ]

    def services(self, hidden: bool = False) -> list[tuple[str, list[str]]]:
        """Return names and types of all services discovered so far."""
        return _visible(self.node.get_service_names_and_types(), hidden)

    def nodes(self, hidden: bool = False) -> list[str]:
        """Return the full names of all nodes discovered so far, sorted, with duplicates."""
        names = [
            f"{absolute(space)}/{name}"
            for name, space in self.node.get_node_names_and_namespaces()
            if hidden or not name.startswith("_")
        ]
        return sorted(names)

    def publishers(self, topic: str) -> list[str]:
        """Return the full names of the nodes that publish a topic, one for each publisher.

        A node's name is discovered after its publishers, which are left out until then.
        """
        ends = self.node.get_publishers_info_by_topic(topic)
        return [name for name in map(node_name, ends) if name]

    def subscribed_types(self, topic: str) -> list[str]:
        """Return the types with which nodes subscribe to a topic."""
        ends = self.node.get_subscriptions_info_by_topic(topic)
        return sorted({end.topic_type for end in ends})

    def find_node(self, name: str) -> str:
        """Return the full name of a running node.

        Raises:
            OneBotError: it was not discovered; the message lists similar names.
        """
        full = name if name.startswith("/") else f"/{name}"
        if not self.look_for(lambda: full in self.nodes(hidden=True), f"the node {full}"):
            raise OneBotError(f'node "{full}" not found{did_you_mean(full, self.nodes(), "nodes")}')
        return full

    def look_for(self, condition: Callable[[], Any], what: str) -> Any:
        """Wait for a condition as long as discovery can take; return its last value."""
        return self.await_or_report(condition, lambda: f"looking for {what} ...", _LOOKUP)

    def await_or_report(
        self,
        condition: Callable[[], Any],
        notice: Callable[[], str],
        timeout: float | None = None,
        patience: float = PATIENCE,
    ) -> Any:
        """Wait for a condition; after some time print what is waited for, again when that changes.

        Args:
            condition: what to wait for.
            notice: returns the text to print.
            timeout: the maximum time to wait, s; None for no limit.
            patience: the time before the notice is printed, s.

        Returns:
            The last value of ``condition()``.
        """
        left, printed = math.inf if timeout is None else timeout, ""
        while True:
            value = self.spin(condition, min(patience, left))
            left -= patience
            if value or left <= 0.0:
                return value
            if (text := notice()) != printed:
                hint = f" ({question()})" if server() and not self._sees_other_nodes() else ""
                print(f"{text}{hint}", file=sys.stderr)
                printed = text


def _visible(names: Iterable[tuple[str, list[str]]], hidden: bool) -> list[tuple[str, list[str]]]:
    return sorted((name, types) for name, types in names if hidden or not is_hidden(name))


def await_acknowledgements(publisher: Any, seconds: float = 1.0) -> None:
    """Wait until all reliable subscribers have the messages, at most ``seconds``."""
    from rclpy.duration import Duration

    if publisher.get_subscription_count():
        publisher.wait_for_all_acked(Duration(seconds=seconds))


def in_session(
    body: Callable[[Session, argparse.Namespace], int | None],
) -> Callable[[argparse.Namespace], int | None]:
    """Return a subcommand that calls ``body`` with a session as its first argument."""

    @functools.wraps(body)
    def run(args: argparse.Namespace) -> int | None:
        with Session(args.ros_args) as session:
            return body(session, args)

    return run
