"""Messages of any type as text, the TF tree, rates, and parameters of nodes, without rclpy."""
