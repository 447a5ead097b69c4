"""Mesh files: where they are, and what is wrong with them."""

import json
import os
import struct
from pathlib import Path

import pytest

from onebot_description.elements.meshes import locate_mesh, mesh_scene
from onebot_description.elements.packages import Resources
from onebot_description.elements.urdf import Mesh
from onebot_description.errors import OneBotError

CHECKOUT = Path(__file__).parents[2]
MESHES = CHECKOUT / "tests/robots/meshes"
LFS = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"


def _head(triangles: int, text: bytes = b"") -> bytes:
    return text.ljust(80, b"\0") + struct.pack("<I", triangles)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        *((f"a{suffix}", LFS, "git lfs pull") for suffix in (".stl", ".dae", ".obj", ".glb")),
        ("a.stl", _head(2) + b"\0" * 50, "holds no triangles, or is cut short; export it again"),
        ("a.stl", _head(1000, b"solid binary"), "cut short"),
        ("a.stl", b"", "cut short"),
        ("a.stl", b"\1\2", "cut short"),
        ("a.stl", _head(0), "holds no triangles"),
        ("a.STL", b"solid a\nfacet normal 0 0 1\n  outer loop\n", "cut short"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\n", "holds no triangles"),
        ("a.dae", b"<COLLADA><asset>", "cannot be read: DaeMalformedError: XML Parsing"),
        ("a.glb", b"glTF" + struct.pack("<II", 2, 1000), "malformed or cut short"),
        ("a.glb", b"<html>", "malformed or cut short"),
        ("a.gltf", b'{"asset": ', "malformed or cut short"),
        ("a.gltf", json.dumps({"buffers": [{"uri": "a.bin"}]}).encode(), "a.bin"),
        ("a.obj", None, "No such file or directory"),
    ],
)
def test_a_broken_mesh_is_explained(tmp_path, name, content, words):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(OneBotError) as caught:
        mesh_scene(Mesh(name, (1.0, 1.0, 1.0), tmp_path / name))
    assert str(caught.value).startswith(f"{tmp_path / name} ") and words in str(caught.value)


@pytest.mark.parametrize(
    ("uri", "words"),
    [
        ("model://arm/a.stl", "model:// is not loaded"),
        ("cubes.stl", "cubes.stl: no such file"),
        ("cube.step", "is of an unsupported kind; convert it to one of: .dae"),
        ("x" * 5000 + ".stl", "cannot be read: File name too long"),
        ("a\0b.stl", ""),
    ],
)
def test_a_mesh_without_a_file_says_why(uri, words):
    mesh = locate_mesh(Resources(MESHES), uri)
    assert mesh.path is None and mesh.problem and words in mesh.problem


def test_a_mesh_with_a_file_has_its_path_and_its_uri():
    mesh = locate_mesh(Resources(MESHES), "cube.stl", (1.0, 2.0, 3.0))
    assert (mesh.path, mesh.problem) == (MESHES / "cube.stl", "")
    assert mesh.uri == (MESHES / "cube.stl").as_uri()
    assert mesh == locate_mesh(Resources(None), mesh.uri, (1.0, 2.0, 3.0))


@pytest.mark.parametrize("suffix", ["stl", "gltf"])
def test_a_huge_file_is_not_read(tmp_path: Path, suffix: str) -> None:
    """Its size tells enough, and its header would promise as much: it may hold nothing at all."""
    huge = tmp_path / f"huge.{suffix}"
    triangles = 40_000_000
    huge.write_bytes(_head(triangles))
    os.truncate(huge, 84 + 50 * triangles)
    with pytest.raises(OneBotError, match="is of 2000 MB, more than 100; simplify it"):
        mesh_scene(Mesh(huge.name, (1.0, 1.0, 1.0), huge))
