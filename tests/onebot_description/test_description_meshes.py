"""Mesh files: which are told apart, and what the text for other programs calls them."""

import shutil
from pathlib import Path
from xml.etree import ElementTree

from onebot_description.description import load_description
from onebot_description.description.checks import is_ascii_stl
from onebot_description.description.description import Mesh

ROBOTS = Path(__file__).parents[1] / "robots"
CUBE = ROBOTS / "meshes" / "cube.stl"


def test_relative_paths_become_absolute_and_nothing_else_is_changed(tmp_path: Path) -> None:
    """The text on robot_description has no folder that a relative path could start from."""
    shutil.copy(CUBE, tmp_path / "cube.stl")
    uris = ["cube.stl", str(CUBE), CUBE.as_uri(), "package://onebot_description/meshes/wheel.dae"]
    visuals = "".join(
        f'<visual><geometry><mesh filename="{uri}"/></geometry></visual>' for uri in uris
    )
    (tmp_path / "r.urdf").write_text(f'<robot name="r"><link name="a">{visuals}</link></robot>')
    description = load_description(tmp_path / "r.urdf")
    expected = [str(tmp_path / "cube.stl"), *uris[1:]]
    meshes = ElementTree.fromstring(description.urdf).iter("mesh")
    assert [mesh.get("filename") for mesh in meshes] == expected
    [link] = description.links
    assert [visual.shape for visual in link.visuals] == [Mesh(uri, (1, 1, 1)) for uri in expected]


def test_text_and_binary_stl_are_told_apart(tmp_path: Path) -> None:
    """A binary STL stays one when its header begins with "solid"."""
    assert is_ascii_stl(ROBOTS / "meshes" / "ascii.stl")
    assert not is_ascii_stl(CUBE)
    disguised = tmp_path / "solid.stl"
    disguised.write_bytes(b"solid" + CUBE.read_bytes()[5:])
    assert not is_ascii_stl(disguised)
