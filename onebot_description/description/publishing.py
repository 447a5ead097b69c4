"""The URDF text that others get to see."""

from xml.etree import ElementTree

from onebot_description.description.meshes import with_absolute_meshes
from onebot_description.description.spec import Description


def published_urdf(description: Description) -> str:
    """Return the URDF text to hand to robot_state_publisher.

    A text has no folder that the relative path of a mesh could start from, so such become absolute.
    """
    meshes = ElementTree.fromstring(description.urdf).iter("mesh")
    if any(_is_relative(mesh.get("filename", "")) for mesh in meshes):
        return with_absolute_meshes(description)
    return description.urdf


def _is_relative(uri: str) -> bool:
    return ":" not in uri and not uri.startswith("/")
