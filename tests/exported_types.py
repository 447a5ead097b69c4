"""What type checkers know of the packages, whose exports are imported lazily.

.ci/run checks this file with mypy, which also reports a ``type: ignore`` without an error.
"""

from collections.abc import MutableSequence

from nav2_msgs.action import NavigateToPose
from nav2_msgs.msg import Costmap
from typing_extensions import assert_type

from onebot_bringup.testing import BringupFixture, RosSimulationFixture, SimulationFixture
from onebot_control import RobotSetup, Simulation
from onebot_description import load_description


def check(
    simulation: SimulationFixture, ros: RosSimulationFixture, bringup: BringupFixture
) -> None:
    """Use what the packages export as a user would, rightly, and then wrongly."""
    assert_type(simulation(world="maze").robot.pose.x, float)
    assert_type(ros(world="maze").simulation.robot.distance_ahead(), float)
    assert_type(bringup("world:=maze").output, str)
    assert_type(load_description("a.urdf").robot_name, str)
    assert_type(Simulation(seed=3, robots={"a": RobotSetup(x=1)}).time, float)
    assert_type(NavigateToPose.Goal(behavior_tree="a").behavior_tree, str)
    assert_type(Costmap(data=[1, 2]).data, MutableSequence[int])
    Simulation(seed="3")  # type: ignore[arg-type]
    Simulation().robot.drive("fast")  # type: ignore[arg-type]
    NavigateToPose.Goal(behavior_tree=3)  # type: ignore[arg-type]
    Costmap().data = "map"  # type: ignore[assignment]
    NavigateToPose.Goal().behaviour_tree = ""  # type: ignore[attr-defined]
