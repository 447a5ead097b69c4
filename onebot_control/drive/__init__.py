"""Differential drive: controller, speed limiter and odometry. No ROS here."""
