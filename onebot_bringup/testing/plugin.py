"""The pytest plugin: fixtures with robots for users' tests.

``simulation`` makes a ``Simulation``, ``ros_simulation`` one with lockstep nodes, and ``bringup``
starts a bringup as processes. Each test has its own ROS domain, ``ros_domain``, so that parallel
tests (``pytest -n 8``) never interfere. Everything is closed after the test.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from onebot_bringup.testing import BringupFixture, RosSimulationFixture, SimulationFixture
    from onebot_bringup.testing.running import RunningBringup
    from onebot_control.nodes.lockstep import Lockstep
    from onebot_control.simulation import Simulation

_MADE = pytest.StashKey["list[Simulation]"]()
_DOMAIN = pytest.StashKey[int]()
_KEPT, _KEPT_RATE = 60.0, 20.0  # how much of a failed test is shown: simulated s, and Hz
_OF_ROS = {"remap", "nav2_topics", "callback_timeout"}  # arguments of Simulation.ros
_FOLDER = "failed_tests"  # folder in pytest's root folder


@pytest.fixture
def simulation(request: pytest.FixtureRequest) -> Iterator[SimulationFixture]:
    """Return a function that makes simulations; its arguments are those of ``Simulation``."""
    from onebot_control.simulation import Simulation

    simulations = request.node.stash.setdefault(_MADE, [])
    with ExitStack() as stack:

        def make(*args: Any, **arguments: Any) -> Simulation:
            simulation = stack.enter_context(Simulation(*args, **arguments))
            simulation.record(_KEPT, _KEPT_RATE)
            simulations.append(simulation)
            return simulation

        yield make


@pytest.fixture
def ros_domain(request: pytest.FixtureRequest) -> Iterator[int]:
    """Set ROS_DOMAIN_ID to a domain that no other test or robot on this computer uses."""
    from onebot_description.ros.domains import used_domain

    with used_domain() as domain:
        request.node.stash[_DOMAIN] = domain
        yield domain


@pytest.fixture
def ros_simulation(
    simulation: SimulationFixture, ros_domain: int
) -> Iterator[RosSimulationFixture]:
    """Return a function that makes simulations with ROS nodes in lockstep.

    Its arguments are those of ``Simulation``, and ``remap``, ``nav2_topics`` and
    ``callback_timeout`` of ``Simulation.ros``; it returns the ``Lockstep`` with the simulation.
    It also initializes rclpy, unless a fixture has: create nodes after it; they are destroyed with
    it. Call it once per test: several robots go into one simulation.
    """
    import rclpy

    with ExitStack() as stack:

        def make(*args: Any, **arguments: Any) -> Lockstep[Simulation]:
            of_ros = {name: arguments.pop(name) for name in _OF_ROS & arguments.keys()}
            if rclpy.ok() and (domain := rclpy.get_default_context().get_domain_id()) != ros_domain:
                text = f"rclpy was initialized before, in domain {domain}: other tests may be there"
                warnings.warn(text, stacklevel=2)
            return stack.enter_context(simulation(*args, **arguments).ros(**of_ros))

        yield make


@pytest.fixture
def bringup(ros_domain: int) -> Iterator[BringupFixture]:
    """Return a function that starts a bringup in real time, and returns when its robots are up.

    Its arguments are words of the command line, such as ``"world:=maze"`` for ``onebot_bringup``;
    ``command="mrm_bringup"`` starts another bringup. There is no viewer unless a word asks for it.
    The bringup ends with the test, and also if pytest is killed.
    """
    from onebot_bringup.testing.running import RunningBringup

    with ExitStack() as stack:

        def start(*words: str, command: str = "onebot_bringup") -> RunningBringup:
            return stack.enter_context(RunningBringup(command, words))

        yield start


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    """Add to the report of a failed test how to repeat the run, and how it ended."""
    report = yield
    if report.when == "call" and report.failed:  # type: ignore[attr-defined]
        sims = item.stash.get(_MADE, [])
        lines = [f"seed {sim.seed}, {sim!r}" for sim in sims]
        lines += [line for number, sim in enumerate(sims) for line in _shown(item, sim, number)]
        if _DOMAIN in item.stash:
            lines.append(f"ROS_DOMAIN_ID {item.stash[_DOMAIN]}")
        if lines:
            report.sections.append(("robots", "\n".join(lines)))  # type: ignore[attr-defined]
    return report


def _shown(item: pytest.Item, simulation: Simulation, number: int) -> list[str]:
    """Write the end of a failed test's simulation to files; return lines for its report."""
    from onebot_bringup.testing.failed_run import show_failed_run

    name = re.sub(r"[^\w.-]+", "_", item.nodeid.replace(".py::", "-"))
    base = item.config.rootpath / _FOLDER / (f"{name}-{number + 1}" if number else name)
    try:
        return [f"the end of it: {file}" for file in show_failed_run(simulation, base)]
    except Exception as error:  # the failure of the test is more important
        return [f"the end of it cannot be shown: {error}"]
