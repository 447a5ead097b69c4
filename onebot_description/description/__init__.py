"""Reads robot descriptions: xacro or URDF in, a ``Description`` with problems and warnings out.

Example:
    >>> from onebot_description.description import describe, load_description
    >>> model = "package://onebot_description/urdf/onebot.urdf.xacro"
    >>> description = load_description(model, {"mesh_enabled": "false"})
    >>> description.root_link
    'base_link'
    >>> text = describe(description)  # a tree of links with joints, masses and shapes
"""

from onebot_description.description.loading import load_description, parse_description
from onebot_description.description.summary import describe
from onebot_description.elements.urdf import Description, Joint, Mimic
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
