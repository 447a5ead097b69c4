"""ROS messages as bytes, as arrays and as objects, and from a JointState to its TFMessage."""
