"""What editors know of the packages, whose exports are imported lazily.

What type checkers know is in ``exported_types.py``.
"""

from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.support import skip_for

if find_spec("jedi") is None:  # as in a workspace of colcon: it comes with ipython
    skip_for("jedi: pip install jedi")

import jedi  # noqa: E402

FIXTURES = "from onebot_bringup.testing import *\ndef test(f: "


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
