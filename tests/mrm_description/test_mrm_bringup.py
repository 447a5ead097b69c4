"""MRM from the command that users type to transforms in another process, and back to nothing."""

import math
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from onebot_description.elements.packages import package_share
from onebot_description.ros.wire.interfaces import TFMessage
from tests.orphans import marked
from tests.ros_support import Peer
from tests.support import RunningProcess, wait_for

Start = Callable[..., RunningProcess]

JOINTS = """/**/joint_state_publisher:
  ros__parameters:
    rate: 50.0
    motions:
      base_link__link_01: {{type: constant, position: {}}}
"""


@pytest.fixture
def start(tmp_path: Path, ros_domain: int) -> Iterator[Start]:
    """Start ``mrm_bringup`` with arguments, without a viewer; nothing may be left of it."""
    with ExitStack() as stack:

        def make(*arguments: str) -> RunningProcess:
            words = [sys.executable, "-m", "mrm_description.launch.mrm_bringup", "viewer:=none"]
            mark = {"ONEBOT_TEST_MARK": str(tmp_path)}
            return stack.enter_context(RunningProcess([*words, *arguments], tmp_path, mark))

        yield make
    assert marked(str(tmp_path)) == []


@pytest.fixture
def tf(peer: Peer) -> list[TFMessage]:
    """What the robot publishes on /tf."""
    return peer.hear(TFMessage, "/tf")


def place(tf: list[TFMessage]) -> tuple[float, float]:
    """Return the latest height (m) of MRM's moving link, and its angle (rad)."""
    [stamped] = tf[-1].transforms
    assert stamped.child_frame_id == "link1"
    transform = stamped.transform
    return transform.translation.z, 2.0 * math.asin(transform.rotation.z)


def test_the_command_alone_moves_mrm(start: Start, tf: list[TFMessage]) -> None:
    """Without arguments the joint moves, /tf says so elsewhere, and Ctrl-C leaves nothing."""
    running = start()
    height, angle = wait_for(lambda: place(tf), "the first transform")
    assert height == pytest.approx(0.5)  # m, the top of the base
    wait_for(lambda: place(tf)[1] != angle, "a movement")
    assert 'Robot "mrm"' in running.out and "Ctrl-C stops everything" in running.out


def test_edits_of_the_joints_and_of_the_xacro_change_the_robot(
    start: Start, tf: list[TFMessage], tmp_path: Path
) -> None:
    """The YAML file is the robot's remote control, while it runs; the log names it alone.

    An edit of the model takes effect at once; a broken one is reported and changes nothing. All
    nodes follow it, also when a joint has gone that the YAML names.
    """
    model, joints = tmp_path / "my_mrm.xacro", tmp_path / "joints.yaml"

    def stands(height: float, angle: float) -> None:
        tf.clear()
        wanted = pytest.approx((height, angle), abs=1e-3)
        wait_for(lambda: place(tf) == wanted, f"{height} m, {angle} rad")

    good = (package_share("mrm_description") / "urdf/mrm.xacro").read_text()
    model.write_text(good)
    joints.write_text(JOINTS.format(0.25))
    running = start(f"model:={model}", f"joints:={joints}")
    stands(0.5, 0.25)
    joints.write_text(JOINTS.format(-0.5))
    stands(0.5, -0.5)
    running.says(f"] {joints}: applied, changed: ")
    taller = good.replace('name="base_side" value="1.0"', 'name="base_side" value="2.0"')
    assert taller != good
    model.write_text(taller.replace("</robot>", ""))
    running.says("stays as it was")
    assert "my_mrm.xacro" in running.err
    stands(0.5, -0.5)
    model.write_text(good)
    running.says(f"{model}: edited, the robot is unchanged")
    model.write_text(taller)
    stands(1.0, -0.5)
    running.says(f"{model}: edited, robot_state_publisher publishes the new robot")
    model.write_text(good.replace("base_link__link_01", "elbow"))
    stands(0.5, 0.0)
    running.says('motions.base_link__link_01: the robot has no joint "base_link__link_01"')
