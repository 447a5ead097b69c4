"""What editors and type checkers know of the packages, whose exports are imported lazily."""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.support import skip_for

if find_spec("jedi") is None:  # as in a workspace of colcon: it comes with ipython
    skip_for("jedi: pip install jedi")

import jedi  # noqa: E402

FIXTURES = "from onebot_bringup.testing import *\ndef test(f: "
TYPED = """
from nav2_msgs.action import NavigateToPose
from nav2_msgs.msg import Costmap
from onebot_bringup.testing import BringupFixture, RosSimulationFixture, SimulationFixture
from onebot_control import RobotSetup, Simulation
from onebot_description import load_description

def test(simulation: SimulationFixture, ros: RosSimulationFixture, bringup: BringupFixture) -> None:
    reveal_type(simulation(world="maze").robot.pose.x)
    reveal_type(ros(world="maze").simulation.robot.drive(0.5))
    reveal_type(bringup("world:=maze").output)
    reveal_type(load_description("a.urdf").robot_name)
    reveal_type(Simulation(seed=3, robots={"a": RobotSetup(x=1)}).time)
    reveal_type(NavigateToPose.Goal(behavior_tree="a").behavior_tree)
    reveal_type(Costmap(data=[1, 2]).data)
    Simulation(seed="3")
    Simulation().robot.drive("fast")
    NavigateToPose.Goal(behavior_tree=3)
    Costmap().data = "map"
    NavigateToPose.Goal().behaviour_tree = ""
"""


@pytest.mark.parametrize(
    ("code", "name"),
    [
        ("from onebot_control import Simu", "Simulation"),
        ("from onebot_description import load_d", "load_description"),
        ("from onebot_bringup.testing import Simu", "SimulationFixture"),
        ("from onebot_control import Simulation\nSimulation().robot.dr", "drive"),
        ("from onebot_control import Simulation\nSimulation(wor", "world="),
        ("from nav2_msgs.act", "action"),
        ("from nav2_msgs.action import Navigate", "NavigateToPose"),
        ("from nav2_msgs.action import NavigateToPose\nNavigateToPose.Goal().beh", "behavior_tree"),
        ("from vision_msgs.msg import Detection2D\nDetection2D().bbox.siz", "size_x"),
        (f"{FIXTURES}SimulationFixture):\n f().robot.dr", "drive"),
        (f"{FIXTURES}BringupFixture):\n f().out", "output"),
    ],
)
def test_jedi_completes(code: str, name: str) -> None:
    environment = jedi.InterpreterEnvironment()
    script = jedi.Script(code, path=Path("/editor.py"), environment=environment)
    assert name in {completion.name for completion in script.complete()}


@pytest.mark.slow
def test_mypy_knows_every_type(tmp_path: Path) -> None:
    (tmp_path / "test_typed.py").write_text(TYPED)
    command = [sys.executable, "-m", "mypy", "--strict", "--ignore-missing-imports"]
    run = subprocess.run(
        [*command, "test_typed.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    lines = run.stdout.splitlines()
    kinds = [
        line.partition("Revealed type is ")[2].strip('"') for line in lines if "note: R" in line
    ]
    expected = ["float", "None", "str", "str", "float", "str", "typing.MutableSequence[int]"]
    assert kinds == expected, run.stdout
    errors = [line.rpartition("[")[2] for line in lines if " error: " in line]
    assert errors == [*["arg-type]"] * 3, "assignment]", "attr-defined]"], run.stdout
