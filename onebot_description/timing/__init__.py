"""Time without ROS: units of stamps, throttled reports, and detection of a stopped process."""

NS_PER_S = 1_000_000_000
"""Nanoseconds per second: stamps are counted in nanoseconds."""
