"""Moves the joints of an arm: trajectories, goals, tolerances, followers. It does not use ROS."""
