"""What moves OneBot."""

import onebot_description  # noqa: F401 - which explains a missing ROS
