"""What RViz did, with Rerun: a robot's scene, its frames and joints, served, saved and drawn.

Nothing here imports rclpy, so all of it works from a notebook or a script. The node that feeds
it is ``onebot_bringup.viewer.rerun_viewer``.
"""

import os

# A recording without a footer is our choice, of which Rerun would warn at every start; that a file
# cannot be written is our own error (display_server.py).
os.environ.setdefault(
    "RUST_LOG", "warn,re_log_encoding::rrd::file_sink=off,re_sdk::recording_stream=off"
)
