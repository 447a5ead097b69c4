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
from onebot_bringup.testing import BringupFixture, RosSimulationFixture, SimulationFixture
from onebot_control import RobotSetup, Simulation
from onebot_description import load_description

def test(simulation: SimulationFixture, ros: RosSimulationFixture, bringup: BringupFixture) -> None:
    reveal_type(simulation(world="maze").robot.pose.x)
    reveal_type(ros(world="maze").simulation.robot.drive(0.5))
    reveal_type(bringup("world:=maze").output)
    reveal_type(load_description("a.urdf").robot_name)
    reveal_type(Simulation(seed=3, robots={"a": RobotSetup(x=1)}).time)
    Simulation(seed="3")
    Simulation().robot.drive("fast")
"""


@pytest.mark.parametrize(
    ("code", "name"),
    [
        ("from onebot_control import Simu", "Simulation"),
        ("from onebot_description import load_d", "load_description"),
        ("from onebot_bringup.testing import Simu", "SimulationFixture"),
        ("from onebot_control import Simulation\nSimulation().robot.dr", "drive"),
        ("from onebot_control import Simulation\nSimulation(wor", "world="),
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
    kinds = [line.partition("Revealed type is ")[2].strip('"') for line in lines[:5]]
    assert kinds == ["float", "None", "str", "str", "float"], run.stdout
    assert [line.partition("[")[2] for line in lines[5:7]] == ["arg-type]"] * 2, run.stdout
