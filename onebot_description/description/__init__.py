"""Robot descriptions: xacro or URDF in, a ``Description`` with its problems and warnings out.

from onebot_description.description import describe, load_description
print(describe(load_description("robot.xacro", {"radius": "0.1"})))
"""

from onebot_description.description.description import Description, Joint, Mimic
from onebot_description.description.loading import load_description, parse_description
from onebot_description.description.summary import describe
from onebot_description.errors import DescriptionError

__all__ = [
    "Description",
    "DescriptionError",
    "Joint",
    "Mimic",
    "describe",
    "load_description",
    "parse_description",
]
