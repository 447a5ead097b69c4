"""OneBot as a Gymnasium environment for reinforcement learning.

It needs ``pip install 'onebot-robots[gym]'``. Importing this module registers ``OneBot-v0`` and
``OneBot-Maze-v0``. Use the id ``onebot_control.environment:OneBot-Maze-v0`` for
``gymnasium.make_vec`` with environments in several processes (vectorization_mode "async").

Example:
    >>> import numpy as np
    >>> from onebot_control.environment import OneBotEnv
    >>> environment = OneBotEnv(world="maze", max_steps=50)
    >>> observation, _ = environment.reset(seed=1)
    >>> observation["scan"].shape, observation["odometry"].shape
    ((360,), (5,))
    >>> observation, reward, terminated, truncated, _ = environment.step(np.array([0.5, 0.0]))
    >>> environment.close()
"""

import math
from typing import Annotated, Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from onebot_control.sensing.readings import RobotPose
from onebot_control.simulated_robot import Positive, SimulatedRobot
from onebot_control.simulation import Simulation
from onebot_description.parameters.arguments import ArgumentError, checked_methods
from onebot_description.parameters.reader import Problem
from onebot_description.parameters.values import Rule, ValueType

_FASTEST = np.array([1.0, 3.0], np.float32)  # m/s, rad/s; the maximum of OneBot's limiter
_NEAR = 0.05  # m; the episode ends when something is closer to the robot's front
_FRONT = 0.25  # m, maximum distance from the lidar to the robot's outline
# m, rad, m/s, rad/s; a space has to be finite, and odometry beyond it is clipped.
_ODOMETRY = np.array([1e4, 1e4, math.pi, 10.0, 100.0], np.float32)

_TWO = Rule(write="an array of two numbers, -1 to 1: forward and to the left")
_Action = Annotated[NDArray[np.float32], ValueType(float, _TWO, many=True, length=2)]
Observation = dict[str, NDArray[np.float32]]


@checked_methods(before=lambda self: self.simulation._core.require_open())
class OneBotEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """A Gymnasium environment of a robot with wheels and a lidar.

    Actions are velocity commands, observations are scan and odometry. Override ``reward`` and
    ``is_over``, which are called after each step, to define a task. By default, the reward is the
    distance driven forward, and an episode is over when the robot is near an obstacle. For an arm,
    write a ``gymnasium.Env`` around ``Simulation``.

    Attributes:
        simulation: the simulation; its ``robot`` is the one that acts.
        action_space: (2,), -1 to 1: fractions of 1 m/s forward and of 3 rad/s to the left.
        observation_space: "scan" (N,): ranges in m, 0 if something is too near, and the maximum
            range if nothing is in range; "odometry" (5,): x, y (m), yaw (rad), linear (m/s) and
            angular velocity (rad/s).
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - as in the base class
        "render_modes": ["rgb_array"],
        "render_fps": 10,
    }

    def __init__(
        self,
        render_mode: Annotated[str, Rule(choices=("rgb_array",))] | None = None,
        *,
        seconds: Positive = 0.1,
        max_steps: Annotated[int, Rule(at_least=1)] = 1000,
        **simulation: Any,
    ) -> None:
        """Build the simulation.

        Args:
            render_mode: None, or "rgb_array" for the camera's image.
            seconds: simulated seconds per step.
            max_steps: steps after which an episode is truncated.
            simulation: arguments of ``Simulation``, such as ``world="maze"``.

        Raises:
            OneBotError: see ``Simulation``; or the robot has no lidar.
        """
        self.render_mode = render_mode
        self._seconds, self._max_steps, self._steps = seconds, max_steps, 0
        self.simulation = Simulation(**{"sensors": True, **simulation})
        scan = self.simulation.robot.scan()
        if seconds < self.simulation.period / 2.0:
            text = f"{seconds:g} is less than a control cycle of {self.simulation.period:g} s"
            raise ArgumentError([Problem("seconds", f"{text}; write one or more of them")])
        self._farthest = np.float32(scan.range_max)
        self.action_space = spaces.Box(-1.0, 1.0, _FASTEST.shape)
        self.observation_space = spaces.Dict(  # type: ignore[assignment] # of a dict of arrays
            {
                "scan": spaces.Box(0.0, scan.range_max, scan.ranges.shape),
                "odometry": spaces.Box(-_ODOMETRY, _ODOMETRY),
            }
        )

    def reset(
        self,
        *,
        seed: Annotated[int, Rule(at_least=0, at_most=2**128 - 1)] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observation, dict[str, Any]]:
        """Go back to the start, and return the first observation.

        Args:
            seed: makes the noise of this and later episodes repeatable.
            options: ignored.

        Returns:
            Observation, as in ``observation_space``, and an empty dict.
        """
        super().reset(seed=seed, options=options)
        self.simulation.reset(seed=int(self.np_random.integers(2**63)))
        self._steps, self._driven = 0, 0.0
        return self._observation(), {}

    def step(self, action: _Action) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Apply an action for one step.

        Args:
            action: (2,), as in ``action_space``; the controller limits faster commands.

        Returns:
            Observation, reward, terminated, truncated, and an empty dict.
        """
        robot = self.simulation.robot
        robot.drive(*(_FASTEST * np.asarray(action)).tolist())
        start = robot.pose
        self.simulation.run(self._seconds)
        self._driven = _distance_forward(start, robot.pose)
        self._steps += 1
        truncated = self._steps >= self._max_steps
        return self._observation(), self.reward(robot), self.is_over(robot), truncated, {}

    def reward(self, robot: SimulatedRobot) -> float:
        """Return the reward of the last step: the meters driven forward in it."""
        return self._driven

    def is_over(self, robot: SimulatedRobot) -> bool:
        """Return whether the episode is over: the robot is about to touch something ahead."""
        return robot.distance_ahead() < _FRONT + _NEAR

    def render(self) -> NDArray[np.uint8] | None:
        """Return the camera's image (height, width, 3), RGB; None if ``render_mode`` is None."""
        return self.simulation.robot.image() if self.render_mode else None

    def close(self) -> None:
        """Free the simulation."""
        self.simulation.close()

    def _observation(self) -> Observation:
        robot = self.simulation.robot
        odometry = robot.odometry
        values = odometry.x, odometry.y, odometry.yaw, odometry.linear, odometry.angular
        return {
            "scan": np.clip(robot.scan().ranges, np.float32(0.0), self._farthest),
            "odometry": np.clip(np.array(values, np.float32), -_ODOMETRY, _ODOMETRY),
        }


gymnasium.register("OneBot-v0", f"{__name__}:{OneBotEnv.__name__}")
gymnasium.register("OneBot-Maze-v0", f"{__name__}:{OneBotEnv.__name__}", kwargs={"world": "maze"})


def _distance_forward(start: RobotPose, end: RobotPose) -> float:
    """Return how far a robot has moved along its mean heading between two poses, m."""
    heading = start.yaw + math.remainder(end.yaw - start.yaw, math.tau) / 2.0
    dx, dy = end.x - start.x, end.y - start.y
    return dx * math.cos(heading) + dy * math.sin(heading)
