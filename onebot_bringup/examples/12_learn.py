"""A reinforcement learning task, to reach a place in the maze; random actions play an episode.

Run it with `python 12_learn.py`. It needs `pip install 'gymnasium>=1.0'`.
"""

from math import hypot

from onebot_control.environment import OneBotEnv


class GoTo(OneBotEnv):
    """Each step costs the distance to the goal; an episode ends there, or with a collision."""

    def distance(self, robot):
        return hypot(1.6 - robot.pose.x, 0.8 - robot.pose.y)  # m

    def reward(self, robot):
        return -self.distance(robot)

    def is_over(self, robot):
        return robot.collided or self.distance(robot) < 0.2


task, rewards, ends = GoTo(world="maze", y=0.8, max_steps=100), [], [False]
task.reset(seed=1)
task.action_space.seed(1)
while not any(ends):
    _, reward, *ends, _ = task.step(task.action_space.sample())
    rewards.append(reward)
print(f"{len(rewards)} steps, a reward of {sum(rewards):.1f}, {-reward:.3f} m left")
