"""onebot_description.joints.config: parameters checked and converted."""

from typing import Any

import pytest

from onebot_description.joints.config import Dependent, JointsConfig
from onebot_description.joints.motions import Keyframes, Sine
from onebot_description.parameters.reader import ConfigError, read


def refused(parameters: dict[str, Any]) -> str:
    """The message with which ``parameters`` are refused."""
    with pytest.raises(ConfigError) as caught:
        read(JointsConfig, parameters)
    return str(caught.value)


def motion(**written: object) -> dict[str, Any]:
    """The parameters of a motion of the joint a."""
    return {"motions": {"a": written}}


def test_defaults_are_those_of_the_standard_node() -> None:
    config = read(JointsConfig, {})
    assert (config.rate, config.source_list, config.delta, config.moves) == (10.0, (), 0.0, False)
    for name in ("swing", "delta"):
        assert f"{name}: -0.5 is below 0" in refused({name: -0.5})
    assert "-0.5 is below 0" in refused(motion(type="sine", amplitude=1.0, frequency=-0.5))
    assert config.publish_default_positions
    assert not config.publish_default_velocities and not config.publish_default_efforts
    assert config.use_mimic_tags and config.use_smallest_joint_limits
    config = read(JointsConfig, {"dependent_joints.a.parent": "b"})
    assert config.dependent_joints == {"a": Dependent("b", 1.0, 0.0)}


ONCE = {"blend": "minimum_jerk", "loop": False}


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        ({"type": "constant", "position": 1}, Keyframes.hold(1.0)),
        ({"type": "sine", "amplitude": 0, "frequency": 0, "phase": 0, "offset": 0}, Sine(0.0, 0.0)),
        (
            {"type": "sine", "amplitude": 1, "frequency": 2, "offset": 3, "phase": 4},
            Sine(1, 2, 4, 3),
        ),
        ({"type": "pose", "pose": "up"}, Keyframes.hold(0.75)),
        (
            {"type": "keyframes", "times": [0, 1], "positions": [0, 0.5]},
            Keyframes((0, 1), (0, 0.5)),
        ),
        (
            {"type": "keyframes", "times": [0.0, 2.0], "poses": ["up", "down"], **ONCE},
            Keyframes((0, 2), (0.75, -0.75), **ONCE),
        ),
    ],
)
def test_every_kind_of_motion_is_read(written: dict[str, Any], expected: object) -> None:
    poses = {"up": {"elbow": 0.75}, "down": {"elbow": -0.75}}
    config = read(JointsConfig, {"poses": poses, "motions": {"elbow": written}})
    assert config.motions["elbow"] == expected
    assert config.moves


HOME = {"poses": {"home": {"a": 0}}}


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        (motion(type="sinus"), 'motions.a.type: no "sinus" (did you mean "sine"?'),
        (motion(type="keyframes", times=[0, 1], positions=[0]), "2 times but 1 positions"),
        (motion(type="keyframes", times=[0, 1, 1], positions=[0, 1, 2]), "must increase, from 0"),
        (motion(type="pose", pose="hme") | HOME, 'did you mean "home"?'),
        (motion(type="pose", pose="home") | {"poses": {"home": {"b": 0}}}, "add poses.home.a"),
        ({"pose": "up"} | HOME, 'pose: no pose "up" (poses: home)'),
        (motion(type="keyframes", times=[0], poses=["x"]), 'motions.a.poses: no pose "x"'),
        (
            {"dependent_joints": {"a": {"factor": 1.0}}},
            "dependent_joints.a: has no parent, the joint it follows",
        ),
        ({"dependent_joints": {"a": {"parent": ""}}}, "dependent_joints.a.parent: is empty; write"),
        (
            motion(position=1.0),
            "motions.a: has no type, the kind of motion, one of constant, sine, keyframes, pose",
        ),
        (
            motion(type="keyframes", times=[0], positions=[1], poses=["home"]) | HOME,
            "either positions or poses",
        ),
    ],
)
def test_mistakes_are_refused_with_the_remedy(parameters: dict[str, Any], words: str) -> None:
    """Each mistake is named, with what would be right."""
    assert words in refused(parameters)


def test_the_edges_of_what_is_possible() -> None:
    assert read(JointsConfig, {"rate": 1000}).rate == 1000.0
    assert read(JointsConfig, {"rate": 0.001}).rate == 0.001
    assert refused({"rate": 1000.5}).startswith("rate: 1000.5 is above 1000")
    once = read(JointsConfig, motion(type="keyframes", times=[0.0], positions=[1.0]))
    assert once.motions == {"a": Keyframes((0.0,), (1.0,))}
    still = read(JointsConfig, motion(type="sine", amplitude=1.0, position=2.0))
    assert still.motions == {"a": Sine(1.0, 0.0)}, "what another type uses is ignored"


@pytest.mark.parametrize(
    ("parameters", "moves"),
    [
        ({"delta": 0.1}, True),
        ({"motions": {"a": {"type": "constant", "position": 0.0}}}, True),
        ({"poses": {"p": {"a": 1.0}}}, False),
        ({"poses": {"p": {"a": 1.0}}, "pose": "p"}, True),
        ({"dependent_joints": {"a": {"parent": "b"}}}, False),
    ],
)
def test_what_moves_the_robot(parameters: dict[str, Any], moves: bool) -> None:
    assert read(JointsConfig, parameters).moves == moves
