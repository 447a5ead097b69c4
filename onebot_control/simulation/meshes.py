"""Collision meshes, rewritten as PyBullet reads them.

Its own readers crash on some broken files, skip ASCII STL and know no glTF; here trimesh reads them
all. As RViz does, a Collada file's unit counts and its axes are left as they are written.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from onebot_control.simulation.bodies import Body
from onebot_description.description import Description
from onebot_description.description.meshes import base_folder, resolve_mesh
from onebot_description.errors import OneBotError


@contextmanager
def converted_meshes(description: Description, bodies: Iterable[Body]) -> Iterator[None]:
    """Have the collision meshes of ``bodies`` rewritten, in files that last as long as the block.

    Raises:
        OneBotError: a mesh cannot be read.
    """
    meshes = [
        (mesh, body.link)
        for body in bodies
        for collision, _ in body.collisions
        for mesh in collision.iter("mesh")
    ]
    if not meshes:
        yield
        return
    # Imported late, as trimesh below: shapes to collide are mostly simple.
    from tempfile import TemporaryDirectory

    base = base_folder(description.source)
    written: dict[str, str] = {}
    with TemporaryDirectory() as folder:
        for mesh, link in meshes:
            source = mesh.get("filename", "")
            if source not in written:
                copy = Path(folder) / f"{len(written)}.obj"
                copy.write_text(_as_obj(resolve_mesh(source, base) or Path(source), link))
                written[source] = str(copy)
            mesh.set("filename", written[source])
        yield


def _as_obj(path: Path, link: str) -> str:
    """The triangles of a mesh file, in metres, as Wavefront OBJ."""
    import trimesh

    owner = f'link "{link}": collision mesh {path}'
    try:
        scene = trimesh.load_scene(str(path), process=False)
        if path.suffix.lower() == ".dae":
            scene = scene.convert_units("meters")
        parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh)]
    except Exception as error:  # trimesh and its parsers raise whatever they stumble over
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise OneBotError(f"{owner} cannot be read: {reason}") from error
    if not any(len(part.faces) for part in parts):
        raise OneBotError(f"{owner} holds no triangles")
    lines, before = [], 1
    for part in parts:
        lines += ["v " + " ".join(map(repr, vertex)) for vertex in part.vertices.tolist()]
        lines += ["f " + " ".join(map(str, face)) for face in (part.faces + before).tolist()]
        before += len(part.vertices)
    return "\n".join(lines) + "\n"
