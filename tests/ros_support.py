"""A peer on the wire and nodes in processes of their own, for tests on real DDS."""

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

import rclpy
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile

from onebot_control.nodes import spinning
from onebot_description.ros.discovery import configure_discovery
from tests.support import PATIENCE, RunningProcess, wait_for

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_LOST = 20.0  # s without an answer of a service


@contextmanager
def node_here(name: str) -> Iterator[Node]:
    """A node of rclpy's default context, for ``spin_until``."""
    rclpy.init()
    node = rclpy.create_node(name)
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


def spin_until(node: Node, condition: Callable[[], Any], what: str) -> Any:
    """Spin a node until a condition is true; return what it returned."""

    def turn() -> Any:
        rclpy.spin_once(node, timeout_sec=0.05)
        return condition()

    return wait_for(turn, what)


class Peer:
    """An rclpy node in the test's process that keeps what it hears; use it as a context."""

    def __init__(self, domain: int, name: str = "peer") -> None:
        self.context = rclpy.Context()
        with patch.dict(os.environ):
            configure_discovery()  # it announces itself often, as ours do: nobody waits for it
            rclpy.init(context=self.context, domain_id=domain, args=[])
            self.node = rclpy.create_node(name, context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._ended = rclpy.Future()
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        try:
            spinning.spin_until(self._ended, self._executor)
        except ExternalShutdownException:
            pass

    def __enter__(self) -> "Peer":
        return self

    def __exit__(self, *_: object) -> None:
        # Executor.shutdown does not wait for a thread that spins, and then rclpy may crash.
        self._ended.set_result(None)
        self._thread.join(PATIENCE)
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def hear(self, kind: Any, topic: str, qos: Any = 100) -> list[Any]:
        """Subscribe; the list returned grows as messages come."""
        heard: list[Any] = []
        self.node.create_subscription(kind, topic, heard.append, qos)
        return heard

    def publisher(self, kind: Any, topic: str, qos: Any = 10, subscribers: int = 1) -> Any:
        """A publisher that has found its subscribers."""
        publisher = self.node.create_publisher(kind, topic, qos)
        wait_for(
            lambda: publisher.get_subscription_count() >= subscribers, f"a subscriber of {topic}"
        )
        return publisher

    def run(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """What a function returns that runs in the thread that spins.

        In another one, rclpy's executor may wait for what was just destroyed, and its action client
        may receive an answer before it has noted whose it is.
        """
        task = self._executor.create_task(function, *arguments)
        wait_for(task.done, f"the node to run {function}")
        return task.result()

    def call(self, kind: Any, name: str, **request: Any) -> Any:
        """The answer of a service, which is asked again where its answer is lost.

        rmw_fastrtps drops an answer ("failed to send response") if the server has not discovered
        the client's reader in time, which takes a machine that is busy just then.
        """
        client = self.node.create_client(kind, name)
        assert client.wait_for_service(PATIENCE), f"no service {name}"
        start, futures = time.monotonic(), list[Any]()

        def answered() -> Any:
            if time.monotonic() >= start + _LOST * len(futures):
                futures.append(client.call_async(kind.Request(**request)))
            return next((future for future in futures if future.done()), None)

        return wait_for(answered, f"{name} to answer").result()

    def set_parameters(self, node: str, **values: Any) -> list[Any]:
        """Set parameters of another node as one request each; the results."""
        parameters = [
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
        ]
        answer = self.call(SetParameters, f"{node}/set_parameters", parameters=parameters)
        return list(answer.results)

    def parameter(self, node: str, name: str) -> Any:
        """The value of a parameter of another node."""
        [value] = self.call(GetParameters, f"{node}/get_parameters", names=[name]).values
        return parameter_value_to_python(value)


class NodeProcess(RunningProcess):
    """``python -m MODULE ARGS``."""

    def __init__(self, module: str, *args: str, check: bool = True) -> None:
        super().__init__([sys.executable, "-u", "-m", module, *args], check=check)


_EACH = """
import importlib, json, sys
main = importlib.import_module(sys.argv[1]).main
for words in json.loads(sys.argv[2]):
    print("exit code", main(["node", *words]), flush=True)
"""


def refusals(module: str, lines: Sequence[Sequence[str]]) -> list[str]:
    """What a node prints for each command line, all of which end it by one error; one process."""
    command = [sys.executable, "-u", "-c", _EACH, module, json.dumps(lines)]
    done = subprocess.run(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=PATIENCE
    )
    *outputs, end = done.stdout.split("exit code 1\n")
    assert (end, len(outputs)) == ("", len(lines)), done.stdout
    assert not any(words in done.stdout for words in ("Traceback", "RuntimeWarning")), done.stdout
    return outputs


def ros_args(**parameters: object) -> list[str]:
    """Command-line arguments that set parameters, each value in YAML's flow form."""
    args: Sequence[str] = [
        word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")
    ]
    return ["--ros-args", *args]
