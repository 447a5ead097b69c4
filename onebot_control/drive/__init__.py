"""What drives a robot by its wheels: controller, speed limiter, odometry. No ROS here."""
