"""What tests of robots use: the pytest plugin, and ROS domains of their own."""
