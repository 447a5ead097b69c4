"""Messages of any type as text, rates, and parameters of nodes, without rclpy."""
