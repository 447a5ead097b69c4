"""Parameters of the controller, right and wrong."""

from typing import Any

import pytest

from onebot_control.drive.wheels.geometry import WheelGeometry
from onebot_control.drive_kinds import ControlConfig
from onebot_description.parameters.reader import ConfigError, defaults, leaves
from tests.onebot_control.control_support import WHEELS

DEFAULTS = defaults(ControlConfig)


def problem(**values: Any) -> str:
    """What is said about these parameters."""
    dotted = {name.replace("__", "."): value for name, value in values.items()}
    with pytest.raises(ConfigError) as caught:
        ControlConfig.from_parameters({**WHEELS, **dotted})
    return str(caught.value)


def test_defaults_are_valid() -> None:
    """The table in the README, which a test compares, has each of them."""
    config = ControlConfig.from_parameters({**DEFAULTS, **WHEELS})
    assert config == ControlConfig.from_parameters(WHEELS)
    config = ControlConfig.from_parameters({**WHEELS, "world_frame_id": ""})
    assert [config.world_frame(in_scene=among) for among in (False, True)] == ["", "world"]


def test_rules_of_the_parameters() -> None:
    rules = {leaf.name: leaf.type.rule for leaf in leaves(ControlConfig)}
    wheels = {"left_wheel_names", "right_wheel_names"}
    at_start = {*wheels, *"update_rate paused robot_description world x y yaw".split()}
    assert {name for name, rule in rules.items() if rule.read_only} == at_start
    lists = {f"joint_state_broadcaster.{name}" for name in ("joints", "interfaces", "extra_joints")}
    assert {name for name, rule in rules.items() if rule.unique} == {*wheels, *lists, "step_topics"}


def test_wheels_may_be_named_on_no_side() -> None:
    """They are found then."""
    config = ControlConfig.from_parameters({})
    assert config.left_wheel_names == config.right_wheel_names == ()


def test_the_multipliers_scale_the_geometry() -> None:
    names = ("wheel_separation", "left_wheel_radius", "right_wheel_radius")
    factors = dict(zip((f"{name}_multiplier" for name in names), (1.5, 0.5, 2.0), strict=True))
    kinematics = ControlConfig.from_parameters({**WHEELS, **factors}).kinematics(
        WheelGeometry(0.25, 0.125)
    )
    lengths = kinematics.separation, kinematics.left_radius, kinematics.right_radius
    assert lengths == (0.375, 0.0625, 0.25)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"left_wheel_names": []}, "right_wheel_names: 1 wheels, but left_wheel_names has 0"),
        (
            {"left_wheel_names": ["a"], "right_wheel_names": ["b", "c"]},
            "right_wheel_names: 2 wheels, but left_wheel_names has 1; name equally many",
        ),
        ({"wheel_separation_multiplier": 0.0}, "wheel_separation_multiplier: 0 is not above 0"),
        ({"update_rate": 1001}, "update_rate: 1001 is above 1000; write a number from 0.001"),
        ({"odom_frame_id": ""}, "odom_frame_id: is empty; write the name of a frame"),
        ({"angular__z__min_jerk": 1.0}, "angular.z.min_jerk: 1 is above 0"),
        ({"joint_state_broadcaster__interfaces": ["torque"]}, 'no "torque"'),
    ],
)
def test_wrong_values(values: dict[str, Any], said: str) -> None:
    assert said in problem(**values)


def test_edges_that_are_allowed() -> None:
    values = {"publish_rate": 10_000, "update_rate": 1e-3, "velocity_rolling_window_size": 1}
    config = ControlConfig.from_parameters({**WHEELS, **values, "use_sim_time": True})
    assert {name: getattr(config, name) for name in values} == values
