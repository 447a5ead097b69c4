import numpy as np
import trimesh

from onebot_description.cad.collada import corner_normals


def test_a_box_keeps_its_edges():
    """Every corner's normal is its face's own."""
    mesh = trimesh.creation.box()
    normals = corner_normals(mesh.vertices, mesh.faces, np.radians(38))
    np.testing.assert_allclose(normals, np.repeat(mesh.face_normals[:, None], 3, axis=1), atol=1e-9)


def test_a_sphere_is_round():
    """Every corner's normal points away from the middle."""
    mesh = trimesh.creation.icosphere(subdivisions=3)
    normals = corner_normals(mesh.vertices, mesh.faces, np.radians(38))
    np.testing.assert_allclose(normals, mesh.vertices[mesh.faces], atol=0.01)


def test_a_cylinder_has_a_round_side_and_flat_ends():
    """The side's normals are horizontal and the ends' are vertical: nothing lies between."""
    mesh = trimesh.creation.cylinder(radius=1.0, height=1.0, sections=48)
    normals = corner_normals(mesh.vertices, mesh.faces, np.radians(38))
    upright = np.abs(normals[..., 2])
    assert np.all((upright < 1e-9) | (upright > 1 - 1e-9))
