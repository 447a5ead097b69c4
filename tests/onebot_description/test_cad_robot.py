"""The committed meshes and inertials are what the dimensions say."""

import importlib
import sys
from pathlib import Path

import collada
import numpy as np
import pytest
import trimesh
import yaml
from lxml import etree

pytest.importorskip("manifold3d", reason="the CAD needs the extra cad")

from manifold3d import Manifold  # noqa: E402

from onebot_description.cad.__main__ import (  # noqa: E402
    make_parts,
    read_dimensions,
    write_robot,
)
from onebot_description.cad.base import add_ballast  # noqa: E402
from onebot_description.cad.solids import union  # noqa: E402
from onebot_description.cad.wheels import axle_position  # noqa: E402
from onebot_description.elements.packages import package_share  # noqa: E402
from onebot_description.errors import OneBotError  # noqa: E402
from onebot_description.model.rigid_bodies import Body  # noqa: E402

SHARE = package_share("onebot_description")
DIMENSIONS = read_dimensions(SHARE / "config/dimensions.yaml")
NAMES = ("base_link", "wheel", "caster_base2", "caswheel")
# What one machine's arithmetic may move against another's: the skins are simplified to 0.1 mm.
TOLERANCE = 2e-4
COLLADA = "{http://www.collada.org/2005/11/COLLADASchema}"


def _load(path: Path) -> trimesh.Scene:
    return trimesh.load_scene(path, process=False)


@pytest.fixture(scope="module")
def fresh(tmp_path_factory) -> Path:
    """A folder with everything made anew."""
    folder = tmp_path_factory.mktemp("cad")
    write_robot(SHARE / "config/dimensions.yaml", folder)
    return folder


@pytest.mark.parametrize("name", NAMES)
def test_the_committed_mesh_is_what_the_dimensions_say(fresh, name):
    made = _load(fresh / f"meshes/{name}.dae")
    committed = _load(SHARE / f"meshes/{name}.dae")
    assert made.geometry.keys() == committed.geometry.keys(), "run python -m onebot_description.cad"
    for key, expected in made.geometry.items():
        found = committed.geometry[key]
        np.testing.assert_allclose(found.bounds, expected.bounds, atol=TOLERANCE, err_msg=key)
        assert found.area == pytest.approx(expected.area, rel=0.01), key
        np.testing.assert_allclose(found.centroid, expected.centroid, atol=2 * TOLERANCE)
        color = getattr(DIMENSIONS.colors, key.split("-")[1])
        shown = np.asarray(found.visual.material.main_color, float)[:3] / 255
        np.testing.assert_allclose(shown, color, atol=0.5 / 255 + 1e-9)


def test_the_committed_inertials_are_what_the_dimensions_say(fresh):
    made = yaml.safe_load((fresh / "config/inertials.yaml").read_text())
    committed = yaml.safe_load((SHARE / "config/inertials.yaml").read_text())
    assert made.keys() == committed.keys() == set(NAMES)
    for name, body in made.items():
        for key, value in body.items():
            found = committed[name][key]
            np.testing.assert_allclose(found, value, rtol=1e-7, atol=1e-9, err_msg=f"{name} {key}")
    base = made["base_link"]
    assert (base["mass"], base["center"]) == (3.978, [-0.108, 0.0, -0.02579])


def test_a_ballast_that_cannot_be_is_refused():
    with pytest.raises(OneBotError, match="weighs 5.000 kg without ballast, more than 3.978"):
        add_ballast(DIMENSIONS, Body("", mass=5.0))


@pytest.mark.parametrize("name", NAMES)
def test_the_files_are_collada_that_every_reader_takes(fresh, name):
    path = fresh / f"meshes/{name}.dae"
    assert path.stat().st_size < 300_000
    root = etree.parse(path).getroot()
    assert root.find(f".//{COLLADA}unit").get("meter") == "1.0"
    assert root.find(f".//{COLLADA}up_axis").text == "Z_UP"
    assert not list(root.iter(f"{COLLADA}polylist", f"{COLLADA}library_nodes"))
    materials = {element.get("id") for element in root.iter(f"{COLLADA}material")}
    assert len(materials) >= 3
    for bound in root.iter(f"{COLLADA}instance_material"):
        assert bound.get("symbol") in materials
        assert bound.get("target") == "#" + bound.get("symbol")
    assert {group.get("material") for group in root.iter(f"{COLLADA}triangles")} == materials
    for geometry in collada.Collada(str(path)).geometries:
        for triangles in geometry.primitives:
            _check_normals(triangles)


def _check_normals(triangles) -> None:
    """Normals have length 1 and stand on the side that the triangles show."""
    corners = np.asarray(triangles.vertex[triangles.vertex_index], float)
    normals = np.asarray(triangles.normal[triangles.normal_index], float)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=2e-3)
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    faces /= np.linalg.norm(faces, axis=1, keepdims=True)
    assert np.einsum("fi,fci->fc", faces, normals).min() > 0.5


def test_nothing_touches_what_turns():
    wheel, caster = DIMENSIONS.wheel, DIMENSIONS.caster
    base, _, fork, roll = (union(part.seen.values()) for part in make_parts(DIMENSIONS))
    inner = wheel.separation / 2 - wheel.width / 2
    hull = base ^ Manifold.cube((1.0, 1.0, 1.0), center=True)
    assert hull.bounding_box()[4] <= inner
    assert (fork ^ roll.translate(axle_position(caster))).volume() < 2e-6 * 0.3  # the axle itself
    place = (caster.x, 0.0, caster.mount_height - wheel.radius - 1e-5)
    both = fork + roll.translate(axle_position(caster))
    for angle in range(0, 360, 15):
        turned = both.rotate((0.0, 0.0, float(angle))).translate(place)
        assert (turned ^ base).volume() < 1e-12, angle


def _files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.rglob("*.*")}


def test_the_command_writes_everything_where_it_is_told(fresh, tmp_path, capsys):
    """Equal dimensions give equal bytes."""
    write_robot(SHARE / "config/dimensions.yaml", tmp_path)
    assert _files(tmp_path) == _files(fresh)
    assert _files(fresh).keys() == {*(f"{name}.dae" for name in NAMES), "inertials.yaml"}
    assert "base_link.dae" in capsys.readouterr().out


def test_without_manifold3d_the_command_says_what_to_install(monkeypatch):
    for name in [name for name in sys.modules if name.startswith("onebot_description.cad.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "manifold3d", None)
    with pytest.raises(SystemExit, match="needs manifold3d: pip install 'onebot-robots.cad.'"):
        importlib.import_module("onebot_description.cad.__main__")
