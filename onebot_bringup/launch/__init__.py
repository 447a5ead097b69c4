"""Bringup scripts, in place of the launch files of the original."""
