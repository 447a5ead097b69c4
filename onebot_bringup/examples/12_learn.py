"""A task for reinforcement learning, to go to a place in the maze; random actions play an episode.

Run it with `python 12_learn.py`. It needs `pip install 'gymnasium>=1.0'`.
"""

from math import hypot

from onebot_control.environment import OneBotEnv


class GoTo(OneBotEnv):
    """Rewards each metre nearer to the place; an episode ends there, or by a collision."""

    distance = 1.6  # m, at the start

    def reward(self, robot):
        before, self.distance = self.distance, hypot(1.6 - robot.pose.x, 0.8 - robot.pose.y)
        return before - self.distance

    def is_over(self, robot):
        return robot.collided or self.distance < 0.2


task, rewards, is_over = GoTo(world="maze", y=0.8, max_steps=100), [0.0], False
task.reset(seed=1)
task.action_space.seed(1)
while not is_over:
    _, reward, *ends, _ = task.step(task.action_space.sample())
    rewards, is_over = [*rewards, reward], any(ends)
print(f"{len(rewards) - 1} steps, {sum(rewards):.3f} m nearer, {task.distance:.3f} m left")
