"""Tools for tests of robots: the pytest plugin, and separate ROS domains."""
