"""A paused robot that another process steps, by simulation_interfaces/srv/StepSimulation.

The floor of a single cycle is a service of the same node that does nothing; of many it is real
time. The stamps on /clock tell whether all cycles were done.
"""

import time
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rosgraph_msgs.msg import Clock

from onebot_description.ros.wire.interfaces import load_interface
from tests.benchmarks.measuring import WrongAnswer, bringup, in_turn, median, over
from tests.benchmarks.report import Report, Result
from tests.ros_support import Peer
from tests.support import PATIENCE, wait_for

_RATE = 100.0  # control cycles a second, Hz
_MANY = 100  # cycles in a step
_LEAST = 5.0  # times real time

_STEP = load_interface("simulation_interfaces/srv/StepSimulation")
_STATE = load_interface("simulation_interfaces/srv/GetSimulationState")


class Caller:
    """Calls services, one at a time, from a thread that does nothing else."""

    def __init__(self, domain: int) -> None:
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain, args=[])
        self._node = rclpy.create_node("caller", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._clients = {
            kind: self._node.create_client(kind, name)
            for kind, name in ((_STEP, "/step_simulation"), (_STATE, "/get_simulation_state"))
        }
        for client in self._clients.values():
            client.wait_for_service(PATIENCE)

    def time(self, kind: Any, **request: Any) -> float:
        """Return how long a call took, s of the wall's time."""
        began = time.perf_counter()
        future = self._clients[kind].call_async(kind.Request(**request))
        self._executor.spin_until_future_complete(future, PATIENCE)
        if not future.done() or future.result().result.result != 1:
            raise WrongAnswer(f"{kind.__name__}: {future.result()}")
        return time.perf_counter() - began

    def close(self) -> None:
        """End."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)


def run(quick: bool) -> Report:
    """Measure steps of one cycle and of many."""
    rounds, calls = (1, 5) if quick else (5, 60)
    with (
        bringup("use_sim_time:=true", "paused:=true", "viewer:=none") as (domain, _),
        Peer(domain) as peer,
    ):
        clocks = peer.hear(Clock, "/clock", 10)
        caller = Caller(domain)
        try:
            taken = in_turn(
                {
                    "one": lambda: median([caller.time(_STEP, steps=1) for _ in range(calls)]),
                    "floor": lambda: median([caller.time(_STATE) for _ in range(calls)]),
                    "many": lambda: caller.time(_STEP, steps=_MANY),
                },
                rounds,
            )
        finally:
            caller.close()
        cycles = rounds * (calls + _MANY)
        expected = round((cycles * 10**9) / _RATE)

        def last() -> bool:
            return bool(clocks) and _nanoseconds(clocks[-1]) == expected

        wait_for(last, f"{cycles} cycles on /clock")
    return [
        Result("one cycle: times real time", 1.0 / _RATE / median(taken["one"])),
        Result("one cycle over an empty call", over(taken["one"], taken["floor"])),
        Result(
            f"{_MANY} cycles: times real time",
            _MANY / _RATE / median(taken["many"]),
            at_least=_LEAST,
        ),
    ]


def _nanoseconds(clock: Clock) -> int:
    return int(clock.clock.sec) * 10**9 + int(clock.clock.nanosec)
