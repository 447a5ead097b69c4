"""Converts ROS messages between bytes, arrays and objects, and JointStates to TFMessages."""
