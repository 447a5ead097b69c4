"""Tools for tests of robots: the pytest plugin, and bringups that run during a test.

The types of the plugin's fixtures are here for annotations::

    from onebot_bringup.testing import SimulationFixture

    def test_it_drives(simulation: SimulationFixture) -> None:
        robot = simulation(world="maze").robot  # type checkers and editors know its methods
"""

import onebot_description

TYPE_CHECKING = not __name__  # false; jedi would skip the names after a literal False

__all__ = ["BringupFixture", "RosSimulationFixture", "RunningBringup", "SimulationFixture"]

if TYPE_CHECKING:
    from onebot_bringup.testing.plugin import (
        BringupFixture,
        RosSimulationFixture,
        SimulationFixture,
    )
    from onebot_bringup.testing.running import RunningBringup
else:
    __getattr__ = onebot_description.lazy(
        globals(),
        {
            "onebot_bringup.testing.plugin": (
                *("BringupFixture", "RosSimulationFixture", "SimulationFixture"),
            ),
            "onebot_bringup.testing.running": ("RunningBringup",),
        },
    )
