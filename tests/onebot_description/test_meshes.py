"""Mesh files: where they are, and what is wrong with them."""

import json
import os
import struct
from pathlib import Path

import pytest

from onebot_description.description.meshes import fault_of, is_ascii_stl, locate_mesh
from onebot_description.description.packages import Resources

CHECKOUT = Path(__file__).parents[2]
MESHES = CHECKOUT / "tests/robots/meshes"
LFS = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"


def _head(triangles: int, text: bytes = b"") -> bytes:
    return text.ljust(80, b"\0") + struct.pack("<I", triangles)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        *((f"a{suffix}", LFS, "git lfs pull") for suffix in (".stl", ".dae", ".obj", ".glb")),
        ("a.stl", _head(2) + b"\0" * 50, "is cut short: it has 134 bytes; its 2 triangles take"),
        ("a.stl", _head(1000, b"solid binary"), "is cut short"),
        ("a.stl", b"\1\2", "is cut short: it has 2 bytes"),
        ("a.stl", _head(0), "holds no triangles"),
        ("a.STL", b"solid a\nfacet normal 0 0 1\n  outer loop\n", "is cut short: it has no endsol"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\n", "holds no faces"),
        ("a.dae", b"<COLLADA><asset>", "is malformed or cut short: line 1: no element found"),
        ("a.dae", b"PK\3\4", "is malformed"),
        ("a.glb", b"glTF" + struct.pack("<II", 2, 1000), "is cut short: 12 bytes of 1000"),
        ("a.glb", b"<html>", "is not binary glTF"),
        ("a.gltf", b'{"asset": ', "is malformed or cut short"),
        ("a.gltf", json.dumps({"buffers": [{"uri": "a.bin"}]}).encode(), 'needs the file "a.bin"'),
    ],
)
def test_a_broken_mesh_is_explained(tmp_path, name, content, words):
    """A Git LFS pointer, and what was not copied to its end."""
    (tmp_path / name).write_bytes(content)
    assert words in fault_of(tmp_path / name)


@pytest.mark.parametrize(
    "path",
    [
        path
        for folder in (MESHES, CHECKOUT / "onebot_description/meshes")
        for path in sorted(folder.iterdir())
        if path.suffix in (".dae", ".glb", ".obj", ".stl") and path.stat().st_size
    ],
    ids=lambda path: path.name,
)
def test_a_whole_mesh_has_no_fault(path):
    """Of every format."""
    assert fault_of(path) == ""


def test_a_file_that_is_gone_is_a_fault(tmp_path):
    """It may go between the look and the reading."""
    assert fault_of(tmp_path / "a.stl") == "cannot be read: No such file or directory"


def test_stl_in_text_form_is_told_by_its_length(tmp_path):
    """Some binary files begin with "solid", too."""
    path = tmp_path / "a.stl"
    path.write_bytes(_head(1, b"solid of a binary") + b"\0" * 50)
    assert not is_ascii_stl(path)
    assert fault_of(path) == ""
    assert is_ascii_stl(MESHES / "ascii.stl")


@pytest.mark.parametrize(
    ("uri", "words"),
    [
        ("package://no_such_package/a.stl", 'no ROS package "no_such_package"'),
        ("http://example.org/a.stl", "nothing is fetched from the network"),
        ("model://arm/a.stl", "model:// is not loaded"),
        ("cubes.stl", 'no such file (did you mean "cube.stl"?'),
        ("cube.step", "is of an unsupported kind; convert it to one of: .dae"),
        ("empty.stl", "is an empty file"),
        ("x" * 5000 + ".stl", "cannot be read: File name too long"),
        ("a\0b.stl", ""),
        (".", "is a folder"),
    ],
)
def test_a_mesh_without_a_file_says_why(uri, words):
    """Nothing is raised: whoever needs the file reports it."""
    mesh = locate_mesh(Resources(MESHES), uri)
    assert mesh.path is None and mesh.problem and words in mesh.problem


def test_a_mesh_with_a_file_has_its_path_and_its_uri():
    """And is equal to the same one as somebody else has found it."""
    mesh = locate_mesh(Resources(MESHES), "cube.stl", (1.0, 2.0, 3.0))
    assert (mesh.path, mesh.problem) == (MESHES / "cube.stl", "")
    assert mesh.uri == (MESHES / "cube.stl").as_uri()
    assert mesh == locate_mesh(Resources(None), mesh.uri, (1.0, 2.0, 3.0))


def test_only_the_first_missing_files_are_compared_with_what_is_there():
    """However many are missing: it takes a look into the folder each time."""
    resources = Resources(MESHES)
    problems = [locate_mesh(resources, f"cube{number}.stl").problem for number in range(30)]
    assert sum("did you mean" in problem for problem in problems) == 20
    assert all("no such file" in problem for problem in problems)


@pytest.mark.parametrize("suffix", ["stl", "obj", "dae", "glb", "gltf"])
def test_a_huge_file_is_not_read(tmp_path: Path, suffix: str) -> None:
    """Its size tells enough, and its header would promise as much: it may hold nothing at all."""
    huge = tmp_path / f"huge.{suffix}"
    triangles = 40_000_000
    huge.write_bytes(_head(triangles))
    os.truncate(huge, 84 + 50 * triangles)
    assert fault_of(huge) == "is of 2000 MB, more than 100; simplify it"
