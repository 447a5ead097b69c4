"""What RViz did, with Rerun: a robot's scene, its frames and joints, served, saved and drawn.

Nothing here needs a running ROS, so all of it works from a notebook or a script. The node that
passes messages to it is ``onebot_bringup.viewer.rerun_viewer``.
"""

import os

# Rerun reads it when it is imported, so it is set here, before any module can import rerun. Its own
# lines on stderr are coloured, and no user can act on them: what matters is reported by the nodes.
os.environ.setdefault("RUST_LOG", "off")
