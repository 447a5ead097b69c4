"""Replaces RViz with Rerun: shows a robot's scene, frames and joints, live or in a file.

Nothing here needs a running ROS, so all of it works from a notebook or a script. The node that
passes messages to it is ``onebot_bringup.viewer.rerun_viewer``.
"""

import os

# Rerun reads this when it is imported, so it is set here, before any module can import rerun. Users
# cannot act on the colored lines that Rerun writes to stderr; the nodes report what matters.
os.environ.setdefault("RUST_LOG", "off")
