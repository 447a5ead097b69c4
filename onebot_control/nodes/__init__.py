"""The ROS side of the controllers: commands, publishers, services and the loop in real time."""
