"""Simulates sensors: ranges, images and inertial measurements, from snapshots of a world.

``surroundings`` holds the shapes that sensors see, ``rays`` casts rays at them, ``clouds``
makes points of what they hit. Each kind of sensor has a file (``lidar``, ``camera``, ``imu``) with
its ``Instrument``, which measures with one sensor of one robot, and a row in ``instruments``.

The ROS side is ``nodes.sensing``, which decides what is due, ``nodes.sensor_messages``, and
``nodes.robot_sensors``, with the topics.
"""
