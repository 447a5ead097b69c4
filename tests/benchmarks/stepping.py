"""A paused robot that another process steps, by simulation_interfaces/srv/StepSimulation.

The floor of a single cycle is a service of the same node that does nothing; of many it is real
time. The stamps on /clock tell whether all cycles were done.
"""

import threading
import time
from typing import Any

from rosgraph_msgs.msg import Clock

from onebot_description.ros.wire.cdr import nanoseconds
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


def _called(client: Any, **request: Any) -> float:
    """Return how long a call of a service took, s of the wall's time."""
    answered = threading.Event()
    began = time.perf_counter()
    future = client.call_async(client.srv_type.Request(**request))
    future.add_done_callback(lambda _: answered.set())
    if not answered.wait(PATIENCE) or future.result().result.result != 1:
        raise WrongAnswer(f"{client.srv_name}: {future.result()}")
    return time.perf_counter() - began


def run(quick: bool) -> Report:
    """Measure steps of one cycle and of many."""
    rounds, calls = (1, 5) if quick else (5, 60)
    with (
        bringup("use_sim_time:=true", "paused:=true", "viewer:=none") as (domain, _),
        Peer(domain) as listener,
        Peer(domain, "caller") as caller,  # whose thread does nothing else
    ):
        clocks = listener.hear(Clock, "/clock", 10)
        step = caller.node.create_client(_STEP, "/step_simulation")
        state = caller.node.create_client(_STATE, "/get_simulation_state")
        assert step.wait_for_service(PATIENCE) and state.wait_for_service(PATIENCE)
        taken = in_turn(
            {
                "one": lambda: median([_called(step, steps=1) for _ in range(calls)]),
                "floor": lambda: median([_called(state) for _ in range(calls)]),
                "many": lambda: _called(step, steps=_MANY),
            },
            rounds,
        )
        cycles = rounds * (calls + _MANY)
        expected = round((cycles * 10**9) / _RATE)

        def last() -> bool:
            return bool(clocks) and nanoseconds(clocks[-1].clock) == expected

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
