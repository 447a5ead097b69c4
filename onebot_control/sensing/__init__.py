"""Sensors of simulated robots: ranges, pictures and inertial measurements of a scene's snapshots.

``scene`` holds what is sensed, ``rays`` casts rays at it; ``lidar``, ``camera`` and ``imu`` turn
arrays into arrays; ``sensors`` decides what is due, and measures in a thread of its own.
"""
