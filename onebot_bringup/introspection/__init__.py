"""Converts messages of any installed type to text and back; no module imports rclpy."""
