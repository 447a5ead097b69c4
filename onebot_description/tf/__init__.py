"""Transforms as ROS messages: ``TFMessage`` is in ``onebot_description.tf.tf_message``."""
