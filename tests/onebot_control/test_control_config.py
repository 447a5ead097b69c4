"""Parameters of the controller, right and wrong."""

import math
from typing import Any

import pytest

from onebot_control.parameters import ControlConfig
from onebot_description.parameters.reader import ConfigError, defaults
from tests.onebot_control.control_support import WHEELS


def problem(**values: Any) -> str:
    """What is said about these parameters."""
    dotted = {name.replace("__", "."): value for name, value in values.items()}
    with pytest.raises(ConfigError) as caught:
        ControlConfig.from_parameters({**WHEELS, **dotted})
    return str(caught.value)


def test_defaults_are_those_of_diff_drive_controller() -> None:
    """With only the wheels named, every parameter has the documented default."""
    config = ControlConfig.from_parameters({**defaults(ControlConfig), **WHEELS})
    assert config == ControlConfig.from_parameters(WHEELS)
    assert config.wheel_separation == config.wheel_radius == 0.0
    assert config.cmd_vel_timeout == 0.5
    assert config.publish_rate == 50.0
    assert config.velocity_rolling_window_size == 10
    assert config.enable_odom_tf and config.position_feedback and config.tf_frame_prefix_enable
    assert not (config.open_loop or config.publish_limited_velocity)
    assert (config.odom_frame_id, config.base_frame_id) == ("odom", "base_link")
    assert config.pose_covariance_diagonal == (0.0,) * 6
    assert math.isnan(config.linear.max_velocity)


def test_whole_numbers_are_numbers() -> None:
    """1 is as good as 1.0."""
    config = ControlConfig.from_parameters(
        {**WHEELS, "linear.x.max_velocity": 1, "wheel_radius": 1}
    )
    assert (config.linear.max_velocity, config.wheel_radius) == (1.0, 1.0)


def test_wheel_names_are_required() -> None:
    """Without names, or with those of one side only, the error says which are missing."""
    assert "left_wheel_names: is empty" in problem(left_wheel_names=[])
    assert "right_wheel_names: is empty" in problem(right_wheel_names=[])
    with pytest.raises(ConfigError) as caught:
        ControlConfig.from_parameters({})
    assert str(caught.value).count("is empty; name joints") == 2


def test_sides_must_have_as_many_wheels() -> None:
    """Two on the left and one on the right is an error that counts them."""
    text = problem(left_wheel_names=["a", "b"], right_wheel_names=["c"])
    assert "right_wheel_names: 1 wheels, but left_wheel_names has 2" in text


def test_a_wheel_is_on_one_side() -> None:
    """A joint named on both sides, or twice on one, is an error."""
    assert '"a" is in left_wheel_names too' in problem(
        left_wheel_names=["a"], right_wheel_names=["a"]
    )
    assert '"a" is there twice' in problem(
        left_wheel_names=["a", "a"], right_wheel_names=["b", "c"]
    )


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"wheel_radius": -0.1}, "wheel_radius: -0.1 is below 0"),
        ({"wheel_separation": "wide"}, 'wheel_separation: "wide" is a text; write a number'),
        ({"wheel_separation_multiplier": 0.0}, "wheel_separation_multiplier: 0 is not above 0"),
        ({"wheel_radius": math.inf}, "wheel_radius: inf is not finite"),
        ({"cmd_vel_timeout": -1.0}, "cmd_vel_timeout: -1 is below 0"),
        ({"open_loop": 1}, "open_loop: 1 is a number; write true or false"),
        (
            {"publish_rate": 0.0},
            "publish_rate: 0 is not above 0; write a number above 0 and",
        ),
        ({"velocity_rolling_window_size": 0}, "velocity_rolling_window_size: 0 is below 1"),
        (
            {"velocity_rolling_window_size": 2.5},
            "window_size: 2.5 is a number; write a whole",
        ),
        (
            {"pose_covariance_diagonal": [1.0, 2.0]},
            "2 numbers; write 6: variances of the odom",
        ),
        ({"pose_covariance_diagonal": []}, "0 numbers; write 6"),
        ({"twist_covariance_diagonal": [-1.0] * 6}, "twist_covariance_diagonal: -1 is below 0"),
        (
            {"twist_covariance_diagonal": [math.nan] * 6},
            "diagonal: nan is not finite",
        ),
        ({"odom_frame_id": ""}, "odom_frame_id: is empty; write the name of a frame"),
        ({"cmd_vel_type": "Twits"}, 'no "Twits" (did you mean "Twist"?'),
        ({"linear__x__max_velocity": -1.0}, "linear.x.max_velocity: -1 is below 0"),
        ({"angular__z__min_jerk": 1.0}, "angular.z.min_jerk: 1 is above 0"),
        ({"linear__x__max_jerk": math.inf}, "linear.x.max_jerk: inf is not finite"),
        ({"real_time_factor": -1.0}, "real_time_factor: -1 is below 0"),
        ({"joint_state_broadcaster__interfaces": ["torque"]}, 'no "torque"'),
        ({"wheel_seperation": 0.3}, 'did you mean "wheel_separation"?'),
        ({"use_stamped_vel": False}, "no longer a parameter; write cmd_vel_type"),
        ({"linear__x__has_velocity_limits": True}, "leave it out, and write max_velocity: .nan"),
    ],
)
def test_wrong_values(values: dict[str, Any], said: str) -> None:
    """Each error names the parameter, the value and the remedy."""
    assert said in problem(**values)


def test_all_problems_are_said_at_once() -> None:
    """Three mistakes give three lines."""
    text = problem(wheel_radius=-1.0, open_loop="no", colour="red")
    assert len(text.splitlines()) == 3
