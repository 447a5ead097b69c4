"""How well wheel odometry follows the truth, and the truth the command, measured in simulation."""

from onebot_control.accuracy.command import main

__all__ = ["main"]
