"""Messages as text and text as messages, for any installed type; nothing here imports rclpy."""
