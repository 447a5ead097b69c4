"""Mesh files: where they are, and whether they are whole.

``locate_mesh`` looks a file up, which is all that publishing a description needs. ``fault_of``
opens it, as ``onebot check`` and ``mesh_scene`` do: it finds what the programs that read meshes
explain badly or not at all.
"""

import json
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from xml.parsers import expat

from onebot_description.description.description import (
    MESH_SUFFIXES,
    Description,
    Mesh,
    Triple,
)
from onebot_description.description.packages import Resources
from onebot_description.description.xml import missing_file, shown_path
from onebot_description.errors import OneBotError

_LFS_POINTER = b"version https://git-lfs.github.com/spec/"
_MOST_BYTES = 100_000_000  # readers take ten times as much memory
_MOST_HINTS = 20  # of one description; each compares the names of a folder
_STL_HEAD, _STL_TRIANGLE = 84, 50  # bytes


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


def fault_of(path: Path) -> str:
    """Return what is wrong with the content of a mesh file, as in "holds no faces"; or ""."""
    try:
        if (size := path.stat().st_size) > _MOST_BYTES:
            return (
                f"is of {size // 1_000_000} MB, more than {_MOST_BYTES // 1_000_000}; simplify it"
            )
        with path.open("rb") as file:
            if file.read(len(_LFS_POINTER)) == _LFS_POINTER:
                return "is a Git LFS pointer in place of the mesh; fetch it with git lfs pull"
        return _FAULTS[path.suffix.lower()](path)
    except (OSError, ValueError) as error:
        return f"cannot be read: {getattr(error, 'strerror', None) or error}"


def is_ascii_stl(path: Path) -> bool:
    """Return whether ``path`` is an STL in its text form."""
    with path.open("rb") as file:
        head = file.read(_STL_HEAD)
    if not head.lstrip().startswith(b"solid"):
        return False
    # Some binary files begin with "solid" too; their length gives them away.
    return path.stat().st_size != _STL_HEAD + _STL_TRIANGLE * _triangles(head)


def _triangles(head: bytes) -> int:
    return int.from_bytes(head[_STL_HEAD - 4 : _STL_HEAD], "little")


def _stl_fault(path: Path) -> str:
    size = path.stat().st_size
    if is_ascii_stl(path):
        with path.open("rb") as file:
            file.seek(max(0, size - 1000))
            return "" if b"endsolid" in file.read().lower() else "is cut short: it has no endsolid"
    with path.open("rb") as file:
        head = file.read(_STL_HEAD)
    promised = _STL_HEAD + _STL_TRIANGLE * _triangles(head)
    if len(head) < _STL_HEAD or size < promised:
        needed = f"; its {_triangles(head)} triangles take {promised}" if head[80:] else ""
        return f"is cut short: it has {size} bytes{needed}"
    return "" if _triangles(head) else "holds no triangles"


def _obj_fault(path: Path) -> str:
    return "" if re.search(rb"^\s*f\s", path.read_bytes(), re.MULTILINE) else "holds no faces"


def _dae_fault(path: Path) -> str:
    try:
        with path.open("rb") as file:
            expat.ParserCreate().ParseFile(file)
    except expat.ExpatError as error:
        return f"is malformed or cut short: line {error.lineno}: {expat.ErrorString(error.code)}"
    return ""


def _glb_fault(path: Path) -> str:
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(12)
    if head[:4] != b"glTF":
        return "is not binary glTF"
    promised = int.from_bytes(head[8:12], "little")
    return f"is cut short: {size} bytes of {promised}" if size < promised else ""


def _gltf_fault(path: Path) -> str:
    try:
        content = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        return f"is malformed or cut short: {error}"
    with suppress(AttributeError, TypeError):  # other forms than glTF's: its reader reports them
        for buffer in content.get("buffers", ()):
            uri = buffer.get("uri", "")
            if uri and not uri.startswith("data:") and not (path.parent / uri).is_file():
                return f'needs the file "{uri}" beside it'
    return ""


_FAULTS: Mapping[str, Callable[[Path], str]] = {
    ".dae": _dae_fault,
    ".glb": _glb_fault,
    ".gltf": _gltf_fault,
    ".obj": _obj_fault,
    ".stl": _stl_fault,
}
assert _FAULTS.keys() == set(MESH_SUFFIXES)


def mesh_faults(description: Description) -> list[str]:
    """Open the mesh files of a robot; return what is wrong with them, each file once."""
    faults: dict[Path, str] = {}
    for link in description.links:
        for part in (*link.visuals, *link.collisions):
            path = part.shape.path if isinstance(part.shape, Mesh) else None
            if path is not None and path not in faults:
                fault = fault_of(path)
                where = f'{part.where}: link "{link.name}": mesh {shown_path(path)}'
                faults[path] = f"{where} {fault}" if fault else ""
    return [text for text in faults.values() if text]
