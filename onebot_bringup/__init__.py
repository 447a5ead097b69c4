"""What starts, shows and steers robots."""

import os

import onebot_description  # which also explains a missing ROS

TYPE_CHECKING = False  # typing's constant; typing is slow to import
__version__: str

if not TYPE_CHECKING:  # else any name would be one of the package
    __getattr__ = onebot_description.lazy({})

# Rerun reads it when it is imported, so it is set here, before any module can import rerun. Its own
# lines on stderr are coloured, and no user can act on them: what matters is reported by the nodes.
os.environ.setdefault("RUST_LOG", "off")
