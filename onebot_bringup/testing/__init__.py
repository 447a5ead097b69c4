"""Tools for tests of robots: the pytest plugin, and bringups that run during a test.

The types of the plugin's fixtures are here for annotations::

    from onebot_bringup.testing import SimulationFixture

    def test_it_drives(simulation: SimulationFixture) -> None:
        robot = simulation(world="maze").robot  # type checkers and editors know its methods
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from onebot_bringup.testing.running import RunningBringup
    from onebot_control.nodes.lockstep import Lockstep
    from onebot_control.simulation import Simulation

__all__ = ["BringupFixture", "RosSimulationFixture", "SimulationFixture"]


class SimulationFixture(Protocol):
    """Type of the fixture ``simulation``: makes a Simulation with the arguments of that class."""

    def __call__(self, *args: Any, **arguments: Any) -> Simulation: ...


class RosSimulationFixture(Protocol):
    """Type of the fixture ``ros_simulation``: as ``simulation``, with ROS nodes in lockstep."""

    def __call__(self, *args: Any, **arguments: Any) -> Lockstep[Simulation]: ...


class BringupFixture(Protocol):
    """Type of the fixture ``bringup``: starts a command with the words of its command line."""

    def __call__(self, *words: str, command: str = ...) -> RunningBringup: ...
