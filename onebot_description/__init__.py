"""What OneBot is, and how any robot's description is read and published."""

import sys

from onebot_description.missing_ros import LastFinder

sys.meta_path.append(LastFinder)
