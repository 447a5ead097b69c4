"""The ROS interface of the navigator in ``onebot_control.navigation``."""
