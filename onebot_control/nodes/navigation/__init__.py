"""The navigator's ROS interface, which translates onto ``onebot_control.navigation``."""
