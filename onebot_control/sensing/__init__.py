"""Sensors of simulated robots: ranges, pictures and inertial measurements of a world's snapshots.

``surroundings`` holds what is seen, ``rays`` casts rays at it; ``lidar``, ``camera`` and ``imu``
turn arrays into arrays; ``instruments`` decides what is due, and measures in a thread of its own;
``nodes.robot_sensors`` is the ROS side: which sensors a robot has, and their topics.
"""
