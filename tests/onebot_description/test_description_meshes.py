"""Where meshes are looked for."""

from pathlib import Path
from xml.etree import ElementTree

import pytest

from onebot_description.description import (
    DescriptionError,
    load_description,
    resolve_mesh,
    with_absolute_meshes,
)
from onebot_description.description.meshes import is_ascii_stl

ROBOTS = Path(__file__).parents[1] / "robots"
CUBE = ROBOTS / "meshes" / "cube.stl"


@pytest.mark.parametrize("uri", ["meshes/cube.stl", str(CUBE), CUBE.as_uri(), f"file:{CUBE}"])
def test_paths_lead_to_the_file(uri: str) -> None:
    """Relative and absolute paths and file:// name the same file."""
    assert resolve_mesh(uri, ROBOTS) == CUBE.resolve()


def test_percent_signs_of_a_file_uri_are_decoded(tmp_path: Path) -> None:
    """A file URI may escape a space."""
    path = tmp_path / "a cube.stl"
    path.write_bytes(CUBE.read_bytes())
    assert resolve_mesh(path.as_uri(), None) == path.resolve()
    assert "%20" in path.as_uri()


def test_package_leads_to_its_share_folder() -> None:
    """package:// is found through the ament index."""
    found = resolve_mesh("package://onebot_description/package.xml", None)
    assert found is not None and found.name == "package.xml"


@pytest.mark.parametrize(
    "uri",
    [
        "meshes/none.stl",
        "package://no_such_package_at_all/a.stl",
        "package://onebot_description/none.stl",
        "package://",
        "package:///a.stl",
        "file://host/a.stl",
        "file://[/a.stl",
        "",
        "meshes",
        "a\0b",
        "x" * 5000,
    ],
)
def test_what_is_not_there_is_none(uri: str) -> None:
    """What leads to no file gives None, however odd it is."""
    assert resolve_mesh(uri, ROBOTS) is None


@pytest.mark.parametrize("uri", ["http://a.org/b.stl", "HTTPS://a.org/b.stl", "model://b/b.stl"])
def test_other_schemes_are_refused(uri: str) -> None:
    """Nothing is fetched from the network, and that is said."""
    with pytest.raises(DescriptionError, match="is not loaded"):
        resolve_mesh(uri, ROBOTS)


def test_meshes_become_absolute() -> None:
    """In the text for other programs each mesh is the absolute path of a file."""
    root = ElementTree.fromstring(
        with_absolute_meshes(load_description(ROBOTS / "good_meshes.urdf"))
    )
    names = [Path(mesh.get("filename", "")) for mesh in root.iter("mesh")]
    assert len(names) == 7
    assert all(name.is_absolute() and name.is_file() for name in names)


def test_text_and_binary_stl_are_told_apart(tmp_path: Path) -> None:
    """A binary STL stays one when its header begins with "solid"."""
    assert is_ascii_stl(ROBOTS / "meshes" / "ascii.stl")
    assert not is_ascii_stl(CUBE)
    disguised = tmp_path / "solid.stl"
    disguised.write_bytes(b"solid" + CUBE.read_bytes()[5:])
    assert not is_ascii_stl(disguised)
