"""The description of MRM, "my robotic manipulator"."""

import onebot_description

TYPE_CHECKING = False  # typing's constant; typing is slow to import
__version__: str

if not TYPE_CHECKING:  # otherwise type checkers accept any name
    __getattr__ = onebot_description.lazy(globals(), {})
