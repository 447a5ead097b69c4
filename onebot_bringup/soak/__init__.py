"""Robots that run for long while faults are injected, and what is measured meanwhile."""
