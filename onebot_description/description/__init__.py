"""Robot descriptions: xacro or URDF in, a checked ``Description`` out.

from onebot_description.description import describe, load_description
print(describe(load_description("robot.xacro", {"radius": "0.1"})))
"""

from onebot_description.description.description import Description, JointSpec, MimicSpec
from onebot_description.description.loading import (
    load_description,
    parse_description,
    published_urdf,
)
from onebot_description.description.meshes import resolve_mesh, with_absolute_meshes
from onebot_description.description.summary import describe
from onebot_description.errors import DescriptionError

__all__ = [
    "Description",
    "DescriptionError",
    "JointSpec",
    "MimicSpec",
    "describe",
    "load_description",
    "parse_description",
    "published_urdf",
    "resolve_mesh",
    "with_absolute_meshes",
]
