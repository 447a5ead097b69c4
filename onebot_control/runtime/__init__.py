"""Runs control cycles in real time: pace, due measurements, frames; without messages or rclpy."""
