"""OneBot as an environment of Gymnasium."""

import doctest
import math
import warnings
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest

from tests.support import skip_for

if find_spec("gymnasium") is None:  # as in a workspace of colcon: it is an extra
    skip_for("gymnasium: pip install 'gymnasium>=1.0'")

import gymnasium  # noqa: E402
from gymnasium.utils.env_checker import check_env  # noqa: E402

from onebot_control import environment  # noqa: E402
from onebot_control.environment import OneBotEnv  # noqa: E402
from onebot_description.errors import OneBotError  # noqa: E402


def test_the_example_of_the_module() -> None:
    found = doctest.testmod(environment)
    assert found.attempted and not found.failed


def test_gymnasium_s_own_check() -> None:
    """With noise on, and pictures; each warning of it is an error."""
    made = OneBotEnv(render_mode="rgb_array", world="maze")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*spec.*")
        check_env(made)
    made.close()


def test_environments_are_registered() -> None:
    """Several at once, each in a process of its own, and each like one of its own."""
    name = "onebot_control.environment:OneBot-Maze-v0"
    several = gymnasium.make_vec(name, num_envs=2, vectorization_mode="async", y=0.8)
    observations, _ = several.reset(seed=[1, 2])
    assert all(np.isfinite(space.high).all() for space in several.single_observation_space.values())
    for _ in range(3):
        observations, rewards, *_ = several.step(np.array([[0.5, 0.0], [0.5, 0.2]]))
    several.close()
    alone = gymnasium.make("OneBot-Maze-v0", y=0.8)
    alone.reset(seed=2)
    for _ in range(3):
        observation, reward, *_ = alone.step(np.array([0.5, 0.2]))
    alone.close()
    assert reward == rewards[1] != rewards[0]
    for key, values in observation.items():
        assert np.array_equal(values, observations[key][1])


def test_an_episode_repeats_by_its_seed_and_ends_near_a_wall() -> None:
    made = OneBotEnv(world="maze", y=0.8, max_steps=60)

    def episode(seed: int) -> list[bytes]:
        made.reset(seed=seed)
        scans = []
        for step in range(1, 61):
            before = made.simulation.robot.pose.x
            observation, reward, terminated, truncated, _ = made.step(np.array([0.5, 0.0]))
            assert reward == pytest.approx(made.simulation.robot.pose.x - before, abs=1e-6)
            assert truncated == (step == 60)
            scans.append(observation["scan"].tobytes())
            if terminated:
                assert 0.2 < made.simulation.robot.distance_ahead() < 0.3
                return scans
        raise AssertionError("it drove on")

    first = episode(4)
    assert first == episode(4) != episode(5)
    made.close()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"seconds": -1}, "seconds: -1 is not above 0"),
        ({"seconds": 0.001}, "seconds: 0.001 is less than a control cycle of 0.01 s"),
        ({"max_steps": 1.5}, "max_steps: 1.5 is a number; write an integer"),
        ({"render_mode": "human"}, 'render_mode: no "human" (known: rgb_array)'),
        ({"seed": "x"}, 'seed: "x" is a string'),
    ],
)
def test_wrong_arguments(arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(OneBotError) as caught:
        OneBotEnv(**arguments)
    assert words in str(caught.value)


def test_wrong_actions() -> None:
    made = OneBotEnv()
    made.reset(seed=np.int64(1))
    wrong = ([0.1], np.zeros(3), np.zeros((2, 1)), np.zeros((1, 2)), None, 1, "ab", [math.nan, 0])
    for action in wrong:
        with pytest.raises(OneBotError, match="action: .*write an array of two numbers"):
            made.step(action)
    with pytest.raises(OneBotError, match="seed: -1 is below 0"):
        made.reset(seed=-1)
    assert made.simulation.time == 0.0
    made.step([0.1, 0.2])
    made.close()
    for call in (made.reset, made.render, lambda: made.step([0.0, 0.0])):
        with pytest.raises(OneBotError, match="simulation has been closed"):
            call()
