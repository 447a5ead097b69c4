"""Mesh files: where they are, and what is wrong with them."""

import json
import os
import re
import struct
from pathlib import Path

import numpy as np
import pytest

from onebot_description.elements.meshes import (
    colored_triangles,
    locate_mesh,
    mesh_scene,
    surfaces,
)
from onebot_description.elements.packages import Resources, package_share
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
        ("a.stl", _head(2) + b"\0" * 50, "has no triangles, or is truncated; export it again"),
        ("a.stl", _head(1000, b"solid binary"), "truncated"),
        ("a.stl", b"", "truncated"),
        ("a.stl", _head(0), "has no triangles"),
        ("a.STL", b"solid a\nfacet normal 0 0 1\n  outer loop\n", "truncated"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\n", "has no triangles"),
        ("a.dae", b"<COLLADA><asset>", "cannot be read: DaeMalformedError: XML Parsing"),
        ("a.glb", b"glTF" + struct.pack("<II", 2, 1000), "malformed or truncated"),
        ("a.gltf", b'{"asset": ', "malformed or truncated"),
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
        ("model://arm/a.stl", "model:// is not supported"),
        ("cubes.stl", "cubes.stl: no such file"),
        ("cube.step", "has an unsupported format; convert it to one of: .dae"),
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
    with pytest.raises(OneBotError, match="has 2000 MB, more than 100; simplify it"):
        mesh_scene(Mesh(huge.name, (1.0, 1.0, 1.0), huge))


ONEBOT_MESHES = sorted((package_share("onebot_description") / "meshes").glob("*.dae"))


@pytest.mark.parametrize("file", ONEBOT_MESHES, ids=lambda file: file.stem)
def test_plain_triangles_are_those_of_the_scene(file: Path) -> None:
    """Bit for bit, and so are their colors."""
    parts = surfaces(mesh_scene(Mesh(str(file), (1.0, 1.0, 1.0), file)))
    plain = colored_triangles(file)
    assert len(plain) == len(parts) > 0
    for (corners, color), part in zip(plain, parts, strict=True):
        assert np.array_equal(corners, part.vertices[part.faces])
        assert np.array_equal(color, part.visual.material.main_color[:3] / 255.0)


@pytest.mark.parametrize(
    ("pattern", "replacement"),
    [
        ('meter="1.0"', 'meter="0.01"'),
        ("<instance_geometry", "<translate>0 0 1</translate><instance_geometry"),
        (
            "<instance_geometry",
            '<matrix sid="transform">1 0 0 0 0 1 0 0 0 0 1 1 0 0 0 1</matrix>\\g<0>',
        ),
        ("<color>0.93 0.94 0.95 1.0</color>", '<texture texture="a" texcoord="b"/>'),
        ('semantic="NORMAL"', 'semantic="COLOR"'),
        ("<p>0 ", "<p>-1 "),
        ("<p>0 ", "<p>"),
        ("</COLLADA>", ""),
        ('stride="3"', 'stride="4"'),
        ("triangles", "polylist"),
    ],
)
def test_other_collada_files_are_left_to_the_scene(
    tmp_path: Path, pattern: str, replacement: str
) -> None:
    text, count = re.subn(pattern, replacement, ONEBOT_MESHES[0].read_text())
    assert count, pattern
    file = tmp_path / "a.dae"
    file.write_text(text)
    assert colored_triangles(file) == []


def test_files_of_other_kinds_are_left_to_the_scene(tmp_path: Path) -> None:
    assert colored_triangles(tmp_path / "a.stl") == []
    assert colored_triangles(tmp_path / "missing.dae") == []
    (tmp_path / "a.dae").write_bytes(LFS)
    assert colored_triangles(tmp_path / "a.dae") == []
