"""Tools that start, show and steer robots."""

import onebot_description  # it also explains a missing ROS

TYPE_CHECKING = False  # typing's constant; typing is slow to import
__version__: str

if not TYPE_CHECKING:  # else type checkers would accept any name of the package
    __getattr__ = onebot_description.lazy(globals(), {})
