"""Reads sensors: the ``<gazebo reference="LINK"><sensor>`` blocks of gz sim and Gazebo classic.

They mean what SDFormat specifies; topics and frames may be named in any way that gz sim or the ROS
plugins of Gazebo classic support. Each kind of sensor has a file (``lidar``, ``camera``, ``imu``)
with its model, elements, reader, outputs and summary, and a row in ``kind_table``.
"""
