"""Transforms as ROS messages: ``TFMessage`` is in ``onebot_description.wire.tf_message``."""
