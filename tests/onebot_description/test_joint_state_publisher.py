"""onebot_description.joint_state_publisher: the node as a process, heard and steered over DDS."""

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rclpy.node import Node
from rclpy.time import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from onebot_description import description_files
from onebot_description.description import Description, load_description
from onebot_description.joint_state_publisher import JointStatePublisher
from onebot_description.ros.command_line import ros_arguments
from onebot_description.ros.wire.cdr import nanoseconds
from onebot_description.timing import NS_PER_S
from tests.ros_support import LATCHED, NodeProcess, Peer, refusals, ros_args, spin_until
from tests.support import PATIENCE, wait_for

JOINT = "base_link__link_01"


def urdf(*joints: str) -> str:
    """A robot of a base and one link on each joint given, as XML of <joint> after its links."""
    links = "".join(f'<link name="link_{number}"/>' for number in range(len(joints)))
    return f'<robot name="mrm"><link name="base_link"/>{links}{"".join(joints)}</robot>'


def joint(number: int, name: str = JOINT, kind: str = "revolute") -> str:
    """One joint; what moves has MRM's limits."""
    limit = '<limit lower="-3.14" upper="3.14" velocity="0.5" effort="1000"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="base_link"/>'
        f'<child link="link_{number}"/><axis xyz="0 0 1"/>'
        f"{'' if kind == 'fixed' else limit}</joint>"
    )


MRM = urdf(joint(0))


def yaml(lines: str) -> str:
    """Parameter YAML of the node."""
    body = "".join(f"    {line}\n" for line in lines.splitlines())
    return f"joint_state_publisher:\n  ros__parameters:\n{body}"


class Listener(Peer):
    """Receives joint states, and publishes and sets what a test asks for."""

    def __init__(self, domain: int) -> None:
        super().__init__(domain, "listener")
        self.states: list[JointState] = self.hear(JointState, "joint_states", 10)
        self.description = self.node.create_publisher(String, "robot_description", LATCHED)

    def hears(self, fits: Callable[[JointState], Any], what: str) -> JointState:
        """Wait for a message, from now on, that fits."""
        return wait_for(self.awaited(fits), what)[0]

    def awaited(self, fits: Callable[[JointState], Any]) -> Callable[[], list[JointState]]:
        """Gives the messages, from now on, that fit."""
        begin = len(self.states)
        return lambda: [state for state in self.states[begin:] if fits(state)]

    def set(self, name: str, value: object) -> str:
        """Set a parameter; returns the reason of a refusal, empty when it was set."""
        [result] = self.set_parameters("joint_state_publisher", **{name: value})
        assert result.successful == (not result.reason)
        return str(result.reason)

    def get(self, name: str) -> Any:
        """Get a parameter."""
        return self.parameter("joint_state_publisher", name)


def says(node: NodeProcess, words: str) -> None:
    """Wait until the node has logged ``words``."""
    wait_for(lambda: words in node.output or node.process.poll() is not None, f'"{words}"')
    assert words in node.output, node.output


Start = Callable[..., NodeProcess]


@pytest.fixture
def start(ros_domain: int) -> Iterator[Start]:
    """Starts nodes; they end by Ctrl-C, without a traceback."""
    with ExitStack() as stack:
        yield lambda *words: stack.enter_context(
            NodeProcess("onebot_description.joint_state_publisher", *words)
        )


@pytest.fixture
def listener(ros_domain: int) -> Iterator[Listener]:
    """A listener in the test's domain."""
    with Listener(ros_domain) as listener:
        yield listener


@pytest.fixture
def mrm(tmp_path: Path) -> str:
    """MRM as a file."""
    file = tmp_path / "mrm.urdf"
    file.write_text(MRM)
    return str(file)


def seconds(state: JointState) -> float:
    """The stamp."""
    return nanoseconds(state.header.stamp) / NS_PER_S


def test_a_saved_file_moves_the_robot(
    start: Start, listener: Listener, mrm: str, tmp_path: Path
) -> None:
    file = tmp_path / "joints.yaml"
    file.write_text(yaml("rate: 50"))
    node = start(mrm, "--ros-args", "--params-file", str(file))
    still = listener.hears(lambda s: True, "the first message")
    assert list(still.name) == [JOINT]
    assert list(still.position) == [0.0]
    assert list(still.velocity) == list(still.effort) == []

    good = f"rate: 50\nmotions:\n  {JOINT}: {{type: constant, position: 0.3}}"
    file.write_text(yaml(good))
    moving = listener.hears(lambda s: len(s.velocity), "a velocity")
    assert abs(moving.velocity[0]) <= 0.5
    listener.hears(lambda s: s.position[0] == 0.3, "the position saved")

    for bad, words in (
        (good.replace("0.3", "[0.3"), f"{file}:5: invalid YAML"),
        (good.replace(JOINT, "elbow"), 'motions.elbow: the robot has no joint "elbow" (joints'),
    ):
        file.write_text(yaml(bad))
        says(node, words)
        assert listener.hears(lambda s: True, "a message").position[0] == 0.3

    fresh = tmp_path / "joints.yaml~"
    fresh.write_text(yaml(good.replace("0.3", "-0.2")))
    fresh.replace(file)
    says(node, "applied, changed: motions")
    listener.hears(lambda s: s.position[0] == -0.2, "the position mended")
    sine = f"motions:\n  {JOINT}: {{type: sine, amplitude: 1.0, frequency: 0.2}}"
    for rate, words in ((50, "lower frequency to 0.0795775"), (20, "applied, changed: rate")):
        file.write_text(yaml(f"rate: {rate}\n{sine}"))
        says(node, words)
    assert node.output.count("lower frequency") == 1
    assert f"{file}:5: motions.{JOINT}: sine at 0.2 Hz peaks" in node.output
    for one, two in zip(listener.states, listener.states[1:], strict=False):
        span = seconds(two) - seconds(one)
        assert abs(two.position[0] - one.position[0]) <= 0.5 * span + 1e-6


def test_parameters_can_be_set_while_it_runs(start: Start, listener: Listener, mrm: str) -> None:
    start(mrm, "--ros-args", "-p", "rate:=50.0")
    listener.hears(lambda s: True, "the first message")
    assert "0.001" in listener.set("rate", 1e-12)
    assert 'no pose "up"' in listener.set("pose", "up")
    assert 'no such parameter (did you mean "rate"?' in listener.set("rates", 5)
    assert 'no joint "elbow"' in listener.set("poses.up.elbow", 0.1)
    assert "write a number" in listener.set("rate", "fast")
    assert listener.set("rate", 100) == ""
    assert listener.set(f"poses.up.{JOINT}", 0.2) == ""
    assert listener.set("pose", "up") == ""
    listener.hears(lambda s: s.position[0] == 0.2, "the pose")
    assert listener.set("pose", "") == ""
    assert listener.set(f"motions.{JOINT}.type", "constant") == ""
    listener.hears(lambda s: s.position[0] == 0.0, "the constant")
    assert listener.set("robot_description", MRM.replace(JOINT, "other")) != ""
    assert listener.get("rate") == 100


def test_the_description_comes_from_the_topic(start: Start, listener: Listener) -> None:
    node = start(
        "--ros-args", "-p", "motions.elbow.type:=constant", "-p", "motions.elbow.position:=0.1"
    )
    says(node, "waiting for the robot description on /robot_description")
    listener.description.publish(String(data="<robot"))
    says(node, "robot_description not applied, still waiting for one:")
    still = '<robot name="zero"><link name="a"/><link name="b"/></robot>'
    listener.description.publish(String(data=still))
    says(node, "no joint moves")
    listener.description.publish(String(data=MRM))
    listener.hears(lambda s: True, "a message")
    assert all(list(state.name) == [JOINT] for state in listener.states)
    says(node, 'motions.elbow: the robot has no joint "elbow" (joints that move')
    two = urdf(joint(0), joint(1, "fixed_one", "fixed"), joint(2, "another"))
    listener.description.publish(String(data=two))
    state = listener.hears(lambda s: len(s.name) == 2, "two joints")
    assert list(state.name) == [JOINT, "another"]


def test_sources_count_more(start: Start, listener: Listener, mrm: str) -> None:
    node = start(mrm, "--ros-args", "-p", "source_list:=[measured]", "-p", "rate:=50")
    measured = listener.node.create_publisher(JointState, "measured", 10)
    listener.hears(lambda s: s.position[0] == 0.0, "the default")
    wait_for(measured.get_subscription_count, "the subscription")

    def received(fits: Callable[[JointState], Any], **values: list[float]) -> JointState:
        """Publish until the node does what fits: a best-effort message may be lost."""
        message = JointState(name=[JOINT], **values)
        fitting = listener.awaited(fits)
        return wait_for(lambda: measured.publish(message) or fitting(), f"{values}")[0]

    mismatched = JointState(name=[JOINT, "other"], position=[0.7])
    warning = "message on measured ignored: 2 names but 1 values of position"
    wait_for(lambda: measured.publish(mismatched) or warning in node.output, "the warning")
    heard = received(lambda s: len(s.velocity), position=[float("nan")], velocity=[0.1])
    assert (heard.position[0], heard.velocity[0]) == (0.0, 0.1)
    heard = received(lambda s: s.position[0] == 0.7, position=[0.7], effort=[3.0])
    assert list(heard.effort) == [3.0]
    assert "joint_states" in listener.set("source_list", ["joint_states"])


def test_later_files_and_the_command_line_override_a_saved_file(
    start: Start, listener: Listener, mrm: str, tmp_path: Path
) -> None:
    file, given = (tmp_path / f"{name}.yaml" for name in ("joints", "given"))
    still = f"motions: {{{JOINT}: {{type: constant, position: "
    file.write_text(yaml(f"rate: 5\ndelta: 0.5\n{still}0.1}}}}"))
    given.write_text(yaml("delta: 0.25"))
    files = ["--params-file", str(file), "--params-file", str(given)]
    start(mrm, "--ros-args", *files, "-p", "rate:=40.0")
    listener.hears(lambda s: s.position[0] == 0.1, "the position in the file")
    file.write_text(yaml(f"rate: 6\ndelta: 0.6\n{still}0.2}}}}"))
    listener.hears(lambda s: s.position[0] == 0.2, "the position saved")
    assert (listener.get("rate"), listener.get("delta")) == (40.0, 0.25)


def test_it_publishes_while_a_saved_description_is_expanded(
    start_node: Callable[..., Node],
    listener: Listener,
    mrm: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    node = start_node(lambda: JointStatePublisher(mrm), rate=50)
    expanding, go_on = threading.Event(), threading.Event()

    def expand(path: str, _: Mapping[str, str]) -> Description:
        expanding.set()
        assert go_on.wait(PATIENCE)
        return load_description(path)

    monkeypatch.setattr(description_files, "load_description", expand)
    Path(mrm).write_text(MRM.replace(JOINT, "renamed"))

    try:
        spin_until(node, expanding.is_set, "the file to be read")
        reached = len(listener.states)
        spin_until(node, lambda: len(listener.states) > reached + 5, "messages")
    finally:
        go_on.set()
    assert list(listener.states[-1].name) == [JOINT]
    spin_until(node, lambda: list(listener.states[-1].name) == ["renamed"], "the new name")


def test_a_joint_can_be_renamed_in_both_files(
    start: Start, listener: Listener, mrm: str, tmp_path: Path
) -> None:
    file = tmp_path / "joints.yaml"
    file.write_text(yaml(f"rate: 50\nmotions:\n  {JOINT}: {{type: constant, position: 0.1}}"))
    node = start(mrm, "--ros-args", "--params-file", str(file))
    listener.hears(lambda s: s.position[0] == 0.1, "the position")
    # As in a test of the standard node: <robot> within another element.
    Path(mrm).write_text(f"<urdf>{MRM.replace(JOINT, 'elbow')}</urdf>")
    says(node, "make <robot> the outermost element")
    says(node, f'motions.{JOINT}: the robot has no joint "{JOINT}"')
    listener.hears(lambda s: list(s.name) == ["elbow"], "the new joint")
    file.write_text(yaml("rate: 50\nmotions:\n  elbow: {type: constant, position: 0.2}"))
    listener.hears(lambda s: list(s.name) == ["elbow"] and s.position[0] == 0.2, "its motion")
    file.write_text(yaml(f"rate: 50\nmotions:\n  {JOINT}: {{type: constant, position: 0.3}}"))
    says(node, f"{file} not applied, the robot continues as before:")
    Path(mrm).write_text(MRM)
    listener.hears(lambda s: list(s.name) == [JOINT] and s.position[0] == 0.3, "the file applied")
    file.unlink()
    says(node, f"{file}: cannot be read: No such file")
    assert listener.hears(lambda s: True, "a message").position[0] == 0.3


def test_sim_time_is_respected(start_node: Callable[..., Any], mrm: str) -> None:
    motion = {f"motions.{JOINT}.type": "constant", f"motions.{JOINT}.position": 3.0}
    words = ros_arguments(["", *ros_args(**motion)])
    node = start_node(lambda: JointStatePublisher(mrm, words), use_sim_time=True, **motion)
    published: list[tuple[float, float]] = []
    note = lambda state: published.append((seconds(state), state.position[0]))  # noqa: E731
    node._output._publisher = SimpleNamespace(publish=note)
    for now in (100.0, 101.0, 103.0):
        node.get_clock().set_ros_time_override(Time(seconds=now))
        node._output.publish()
    assert published == [(100.0, 0.0), (101.0, 0.5), (103.0, 1.5)]


def test_mistakes_at_the_start_end_it(ros_domain: int, mrm: str) -> None:
    mistakes = [
        (["-p", "source_list:=['no good']"], 'source_list: "no good" is not a valid name'),
        (["-r", "joint_states:=/rosout"], "a node can use a topic with only one type"),
    ]
    lines = [[mrm, "--ros-args", *arguments] for arguments, _ in mistakes]
    outputs = refusals("onebot_description.joint_state_publisher", lines)
    for output, (_, words) in zip(outputs, mistakes, strict=True):
        assert words in output
