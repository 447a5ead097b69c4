"""Simulates sensors: ranges, images and inertial measurements, from snapshots of a world.

``surroundings`` contains the shapes that sensors see, ``rays`` casts rays at them, and ``clouds``
converts the hits to points. Each kind of sensor has a module (``lidar``, ``camera``, ``imu``) with
its ``Instrument``, which measures with one sensor of one robot, and a row in ``INSTRUMENTS``.

``runtime.sensing`` decides which sensors are due; ``nodes.sensor_messages`` and
``nodes.robot_sensors`` publish the measurements.
"""
