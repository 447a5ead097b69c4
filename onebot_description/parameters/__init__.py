"""Reads and checks parameters of YAML files and ROS nodes."""
