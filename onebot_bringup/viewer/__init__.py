"""What RViz did, with Rerun: a robot's scene, its frames and joints, served, saved and drawn.

Nothing here needs a running ROS, so all of it works from a notebook or a script. The node that
passes messages to it is ``onebot_bringup.viewer.rerun_viewer``.
"""
