"""Finds a robot's way: maps by scans, localizes, plans and follows, as a pure core without ROS."""
