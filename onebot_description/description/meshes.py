"""Where mesh files are, without opening them: all that publishing a description needs."""

from pathlib import Path

from onebot_description.description.description import MESH_SUFFIXES, Mesh, Triple
from onebot_description.description.packages import Resources
from onebot_description.description.xml import missing_file, shown_path
from onebot_description.errors import OneBotError

_MOST_HINTS = 20  # a description; each compares the names of a folder


def locate_mesh(resources: Resources, uri: str, scale: Triple = (1.0, 1.0, 1.0)) -> Mesh:
    """Return the mesh that ``uri`` names, with its file or with the reason why there is none."""
    try:
        path, uri = resources.locate(uri)
    except OneBotError as error:
        return Mesh(uri, scale, problem=str(error))
    try:
        problem = "" if path.is_file() else _missing(resources, path)
        problem = problem or _unsuitable(path)
    except (OSError, ValueError) as error:
        problem = f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}"
    return Mesh(uri, scale, None if problem else path, problem)


def _missing(resources: Resources, path: Path) -> str:
    """The message about a file that is not there; for the first few with what is there instead."""
    resources.missing += 1
    many = resources.missing > _MOST_HINTS
    return f"{shown_path(path)}: no such file" if many else missing_file(path)


def _unsuitable(path: Path) -> str:
    """Why the file ``path`` is no mesh, without opening it."""
    if path.suffix.lower() not in MESH_SUFFIXES:
        kinds = ", ".join(MESH_SUFFIXES)
        return f'"{path.name}" is of an unsupported kind; convert it to one of: {kinds}'
    return "" if path.stat().st_size else f'"{path.name}" is an empty file; export it again'
