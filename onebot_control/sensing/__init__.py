"""Simulates sensors: ranges, images and inertial measurements, from snapshots of a world.

``surroundings`` holds the shapes that sensors see, ``rays`` casts rays at them; ``lidar``,
``camera`` and ``imu`` turn arrays into measurements; ``instruments`` measures with one sensor of
one robot. The ROS side is ``nodes.sensing``, which decides what is due, and
``nodes.robot_sensors``, with the topics.
"""
