"""The ROS side of the controllers: commands, publishers, services and the real-time loop."""
