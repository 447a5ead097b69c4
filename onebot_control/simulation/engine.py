"""PyBullet, imported without the line it prints about itself."""

from onebot_control.simulation.output import captured

with captured(1, 2):
    import pybullet as engine

__all__ = ["engine"]
