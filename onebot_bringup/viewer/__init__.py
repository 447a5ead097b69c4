"""What RViz did, with Rerun: a robot's scene, its frames and joints, served, saved and drawn.

Nothing here imports rclpy, so all of it works from a notebook or a script. The node that feeds
it is ``onebot_bringup.viewer.rerun_viewer``.
"""
