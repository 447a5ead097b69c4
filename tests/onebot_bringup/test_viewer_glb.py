import io
import json
import re

import numpy as np
import pytest
import trimesh
from PIL import Image

from onebot_bringup.cli import check
from onebot_bringup.viewer.core.glb import load_mesh
from onebot_bringup.viewer.core.robot_shapes import corners, file_state
from onebot_control.sensing.solids import solid_of
from onebot_description.elements.meshes import locate_mesh, mesh_corners
from onebot_description.elements.packages import Resources
from onebot_description.elements.urdf import Box, Capsule, Cylinder, Geometry, Sphere
from onebot_description.geometry.poses import Origin
from tests.onebot_bringup.viewer_support import ORANGE, box, write_collada, write_obj

BOUNDS = [[-0.5, -0.3, -0.15], [0.5, 0.3, 0.15]]


def _mesh(uri, scale=(1.0, 1.0, 1.0)):
    return locate_mesh(Resources(None), uri, scale)


def _load(path, scale=(1.0, 1.0, 1.0)):
    mesh = _mesh(str(path), scale)
    return load_mesh(mesh, file_state(mesh))


def _glb(asset) -> trimesh.Scene:
    return trimesh.load_scene(io.BytesIO(asset.glb), file_type="glb", process=False)


def _materials(asset) -> list:
    return [part.visual.material for part in _glb(asset).geometry.values()]


@pytest.mark.parametrize(("meter", "up_axis"), [(1.0, "X_UP"), (0.01, "Y_UP"), (0.0254, "Z_UP")])
def test_collada_has_the_size_of_the_same_stl(tmp_path, meter, up_axis):
    """<unit> scales, and <up_axis> turns nothing, as in RViz."""
    box().export(tmp_path / "box.stl")
    stl = _load(tmp_path / "box.stl")
    dae = _load(write_collada(tmp_path / "box.dae", meter, up_axis))
    for asset in (stl, dae):
        np.testing.assert_allclose(asset.bounds, BOUNDS, atol=1e-6)
        np.testing.assert_allclose(_glb(asset).bounds, BOUNDS, atol=1e-6)


def test_collada_keeps_its_colors_in_linear_light(tmp_path):
    """A glTF means linear light: the file's sRGB is converted, and shown as it was."""
    asset = _load(write_collada(tmp_path / "box.dae", 1.0, "Z_UP"))
    assert asset.colored
    linear = [np.asarray(material.baseColorFactor) / 255 for material in _materials(asset)]
    expected = [((value / 255 + 0.055) / 1.055) ** 2.4 for value in ORANGE[:2]]
    assert any(np.allclose(color[:2], expected, atol=0.01) for color in linear)
    assert len(linear) == 2


def test_no_collada_is_invisible(tmp_path):
    """Blender wrote an alpha of 0 for what it and RViz draw opaque, as JVRC-1's meshes have it."""
    path = write_collada(tmp_path / "box.dae", 1.0, "Z_UP")
    clear = "<transparent opaque='A_ONE'><color>1 1 1 0</color></transparent>"
    text = re.sub("<transparent>.*?</transparent>", clear, path.read_text(), flags=re.DOTALL)
    assert clear in text
    path.write_text(text)
    assert {material.baseColorFactor[3] for material in _materials(_load(path))} == {255}


def test_only_what_rerun_knows_of_a_vertex_is_written(tmp_path):
    """Collada with colors of vertices, as of KUKA's LBR iiwa, was not shown at all."""
    path = write_collada(tmp_path / "box.dae", 1.0, "Z_UP")
    color = '<input semantic="COLOR" source="#verts-array" offset="0"/><p>'
    path.write_text(path.read_text().replace("<p>", color))
    glb = _load(path).glb
    tree = json.loads(glb[20 : 20 + int.from_bytes(glb[12:16], "little")])
    primitives = [part for mesh in tree["meshes"] for part in mesh["primitives"]]
    assert {tuple(part["attributes"]) for part in primitives} == {("POSITION", "NORMAL")}


def test_collada_with_a_broken_material_keeps_its_surfaces(tmp_path):
    """Blender leaves references to textures that were taken out; RViz shows such a mesh."""
    path = write_collada(tmp_path / "box.dae", 0.01, "Z_UP")
    whole = _load(path)
    lost = "<newparam sid='t'><sampler2D><source>gone</source></sampler2D></newparam>"
    path.write_text(path.read_text().replace("<profile_COMMON>", f"<profile_COMMON>{lost}"))
    asset = _load(path)
    np.testing.assert_allclose(asset.bounds, whole.bounds, atol=1e-6)
    assert len(_glb(asset).geometry) == len(_glb(whole).geometry)


def test_stl_has_no_color_of_its_own_and_sharp_edges(tmp_path):
    """A box's normals stand square on its faces, so that it looks like a box."""
    box().export(tmp_path / "box.stl")
    asset = _load(tmp_path / "box.stl")
    assert not asset.colored
    for part in _glb(asset).geometry.values():
        np.testing.assert_allclose(np.abs(part.vertex_normals).max(axis=1), 1.0, atol=1e-6)


def test_a_round_stl_is_shaded_round(tmp_path):
    """A cylinder's side is smooth: each corner's normal points straight out."""
    trimesh.creation.cylinder(radius=1, height=1, sections=32).export(tmp_path / "c.stl")
    [part] = _glb(_load(tmp_path / "c.stl")).geometry.values()
    side = np.abs(part.vertex_normals[:, 2]) < 0.5
    out = part.vertices[side, :2] / np.linalg.norm(part.vertices[side, :2], axis=1)[:, None]
    np.testing.assert_allclose(part.vertex_normals[side, :2], out, atol=0.05)


def test_obj_is_colored_only_with_a_material(tmp_path):
    """An OBJ without usemtl takes the URDF's color, one with it keeps its own."""
    assert not _load(write_obj(tmp_path / "plain.obj")).colored
    asset = _load(write_obj(tmp_path / "orange.obj", "orange"))
    assert asset.colored
    np.testing.assert_allclose(asset.bounds, BOUNDS)
    assert np.asarray(_materials(asset)[0].baseColorFactor)[0] == 255


@pytest.mark.parametrize("suffix", ["glb", "gltf"])
@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (1.0, 2.0, -3.0)])
def test_what_is_up_in_gltf_is_up(tmp_path, suffix, scale):
    """As in RViz since 2025: x stays, y becomes z, z becomes -y, and then its scale counts.

    So it is for the viewer, the simulation and its sensors, and for ``onebot check``.
    """
    arrow = trimesh.creation.box(bounds=[[0.0, 0.0, -0.1], [0.1, 0.5, 0.2]])
    exported = trimesh.Scene([arrow]).export(file_type=suffix)
    files = exported if suffix == "gltf" else {"arrow.glb": exported}
    for name, content in files.items():
        (tmp_path / name.replace("model", "arrow")).write_bytes(content)
    expected = np.sort(np.array([[0.0, -0.2, 0.0], [0.1, 0.1, 0.5]]) * scale, axis=0)
    mesh = _mesh(str(tmp_path / f"arrow.{suffix}"), scale)
    asset = load_mesh(mesh, file_state(mesh))
    points = mesh_corners(mesh)
    for bounds in (asset.bounds, _glb(asset).bounds, [points.min(axis=0), points.max(axis=0)]):
        np.testing.assert_allclose(bounds, expected, atol=1e-6)
    solid = solid_of([(Geometry(mesh, Origin()), np.eye(4))])
    np.testing.assert_allclose(solid.box, expected, atol=1e-6)


@pytest.mark.parametrize(
    "written",
    [
        "wood grain.png",
        "-s 2 2 1 -o 0.5 wood grain.png",
        "-blendu off -mm 0 1 -bm 0.2 -s 1 wood grain.png",
        "-clamp on textures\\wood grain.png",
        "textures/wood grain.png",
        "C:\\Users\\me\\wood grain.png",
        "../wood%20grain.png",
        '"wood grain.png"',
    ],
)
def test_a_texture_is_found_however_it_is_written(tmp_path, written):
    folder = tmp_path / "meshes"
    (folder / "textures").mkdir(parents=True)
    place = folder / "textures" if "textures" in written else folder
    place = tmp_path if written.startswith("..") else place
    Image.new("RGB", (2, 2), (200, 10, 10)).save(place / "wood grain.png")
    asset = _load(_textured(folder, written))
    assert asset.warnings == ()
    [material] = _materials(asset)
    assert material.baseColorTexture.getpixel((0, 0))[:3] == (200, 10, 10)


def _textured(folder, written):
    (folder / "flag.mtl").write_text(f"newmtl flag\nmap_Kd {written}\n")
    (folder / "flag.obj").write_text(
        "mtllib flag.mtl\nusemtl flag\nv 0 0 0\nv 0 1 0\nv 0 1 1\n"
        "vt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n"
    )
    return folder / "flag.obj"


@pytest.mark.parametrize("lost", ["texture", "materials", "collada"])
def test_a_file_that_a_mesh_lacks_for_its_look_is_named(tmp_path, lost, capsys, caplog):
    """By the view, by cameras and by ``onebot check``, once each; its surfaces are there.

    Nobody sees the look of a collision shape.
    """
    name = "wood 1.png" if lost != "materials" else "flag.mtl"
    path = _textured(tmp_path, f"-s 1 1 1 textures\\{name}")
    if lost == "materials":
        (tmp_path / name).unlink()
    if lost == "collada":
        path = write_collada(tmp_path / "box.dae", 1.0, "Z_UP")
        surface = (
            "<newparam sid='s'><surface type='2D'><init_from>i</init_from></surface></newparam>"
            "<newparam sid='t'><sampler2D><source>s</source></sampler2D></newparam>"
        )
        text = path.read_text().replace("<profile_COMMON>", f"<profile_COMMON>{surface}")
        texture = "<diffuse><texture texture='t' texcoord='u'/></diffuse>"
        text = re.sub("<diffuse>.*?</diffuse>", texture, text, flags=re.DOTALL)
        image = (
            f"<library_images><image id='i'><init_from>{name}</init_from></image></library_images>"
        )
        path.write_text(text.replace("<library_effects>", f"{image}<library_effects>"))
    words = "it is drawn without this file, which is missing: "
    [warning] = _load(path).warnings
    assert warning.startswith(f"{path}: {words}") and warning.endswith(name)
    visual = f'<visual><geometry><mesh filename="{path}"/></geometry></visual>'
    (tmp_path / "r.urdf").write_text(
        f'<robot name="r"><link name="a">{visual}{visual}</link></robot>'
    )
    assert check.run([str(tmp_path / "r.urdf")]) == 0
    assert capsys.readouterr().err.splitlines() == [f"warning: {warning}"]
    text = (tmp_path / "r.urdf").read_text().replace("visual>", "collision>")
    (tmp_path / "r.urdf").write_text(text)
    assert check.run([str(tmp_path / "r.urdf")]) == 0
    assert capsys.readouterr().err == ""
    [part] = {_mesh(str(path))}
    assert len(solid_of([(Geometry(part, Origin()), np.eye(4))]).faces)
    assert caplog.messages == [f"{warning}; cameras do not see it"]


def test_a_mesh_is_converted_once_until_its_file_changes(tmp_path):
    """The same object comes back; a new file gives a new one."""
    path = tmp_path / "box.stl"
    box().export(path)
    first = _load(path)
    assert _load(path) is first
    trimesh.creation.box(extents=(2, 2, 2)).subdivide().export(path)
    np.testing.assert_allclose(_load(path).bounds, [[-1, -1, -1], [1, 1, 1]])


@pytest.mark.parametrize(
    ("shape", "half"),
    [
        (Box((0.2, 0.4, 0.6)), (0.1, 0.2, 0.3)),
        (Cylinder(0.2, 0.6), (0.2, 0.2, 0.3)),
        (Sphere(0.2), (0.2, 0.2, 0.2)),
        (Sphere(0.0), (0.0, 0.0, 0.0)),
        (Capsule(0.2, 0.6), (0.2, 0.2, 0.5)),
    ],
)
def test_primitives_have_their_size(shape, half):
    """Centered on their origin."""
    points = corners(Geometry(shape, Origin()))
    np.testing.assert_allclose([points.min(axis=0), points.max(axis=0)], [np.negative(half), half])


def test_a_mesh_is_scaled_and_mirrored(tmp_path):
    """By the URDF's scale, after the file's own unit; its faces still look outwards."""
    for file in (write_obj(tmp_path / "a.obj"), write_collada(tmp_path / "a.dae", 0.01, "Z_UP")):
        asset = _load(file, (1.0, -2.0, 3.0))
        np.testing.assert_allclose(asset.bounds, np.multiply(BOUNDS, [1, 2, 3]), atol=1e-6)
        assert all(part.volume > 0 for part in _glb(asset).geometry.values() if part.is_watertight)
