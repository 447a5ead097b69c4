"""Bringup scripts, which replace the original launch files."""
