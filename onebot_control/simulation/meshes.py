"""Collision meshes, rewritten as PyBullet reads them.

Its own readers crash on some broken files, skip ASCII STL and know no glTF; here trimesh reads them
all. As RViz does, a Collada file's unit counts and its axes are left as they are written.
"""

from collections.abc import Iterable
from pathlib import Path

from onebot_control.simulation.bodies import Body
from onebot_description.errors import OneBotError


def convert_meshes(bodies: Iterable[Body], folder: Path) -> None:
    """Write the collision meshes of ``bodies`` into ``folder`` and point the bodies there.

    Raises:
        OneBotError: a mesh cannot be read.
    """
    written: dict[str, Path] = {}
    for body in bodies:
        for collision, _ in body.collisions:
            for mesh in collision.iter("mesh"):
                source = mesh.get("filename", "")
                if source not in written:
                    written[source] = folder / f"{len(written)}.obj"
                    written[source].write_text(_as_obj(Path(source), body.link))
                mesh.set("filename", str(written[source]))


def _as_obj(path: Path, link: str) -> str:
    """The triangles of a mesh file, in metres, as Wavefront OBJ."""
    import trimesh  # slow, and rarely needed: shapes to collide are mostly simple

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
