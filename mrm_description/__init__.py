"""The description of MRM, "my robotic manipulator"."""

import onebot_description

TYPE_CHECKING = bool()  # false, but jedi would leave out what `False` excludes; typing is slow
__version__: str

if not TYPE_CHECKING:  # else any name would be one of the package
    __getattr__ = onebot_description.lazy({})
