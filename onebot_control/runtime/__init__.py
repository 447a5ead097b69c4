"""Runs control cycles in real time: pace, due measurements, frames. Without messages or rclpy."""
