"""What starts, shows and steers robots."""

import os

import onebot_description  # noqa: F401 - which explains a missing ROS

TYPE_CHECKING = False  # typing's constant; typing is slow to import
__version__: str

if not TYPE_CHECKING:  # else any name would be one of the package
    from onebot_description import __getattr__  # noqa: F401 - which knows __version__

# Rerun reads it when it is imported, so it is set here, before any module can import rerun. Its own
# lines on stderr are coloured, and no user can act on them: what matters is reported by the nodes.
os.environ.setdefault("RUST_LOG", "off")
