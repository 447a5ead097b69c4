"""Where meshes lie: ``package://``, ``file://``, absolute and relative paths, never the network."""

from pathlib import Path
from urllib.parse import unquote, urlsplit
from xml.etree import ElementTree

from onebot_description.description.description import Description
from onebot_description.errors import DescriptionError, OneBotError

MESH_SUFFIXES = (".dae", ".glb", ".gltf", ".obj", ".stl")
_PACKAGE = "package://"


def find_package(name: str, base: Path | None = None) -> Path:
    """Return the share folder of a ROS package, installed or being worked on.

    Args:
        name: the package.
        base: a folder; if no installed package has that name, one of its parents, or a folder
            beside those with a package.xml, may be the package's source.

    Raises:
        OneBotError: there is no such package; the message lists near names.
    """
    from onebot_description.description.packages import package_share

    try:
        return package_share(name)
    except OneBotError:
        for folder in () if base is None else (base, *base.parents):
            for source in (folder, folder / name):
                if source.name == name and (source / "package.xml").is_file():
                    return source
        raise


def resolve_mesh(uri: str, base_dir: Path | None) -> Path | None:
    """Return the absolute path of the mesh that ``uri`` names, or None if there is no such file.

    Args:
        uri: ``package://name/path``, ``file:///path``, an absolute path or one relative to
            ``base_dir``.
        base_dir: the folder of the file that names the mesh; None if it is in no file.

    Raises:
        DescriptionError: ``uri`` is of a kind that is not loaded, such as ``http://``.
    """
    scheme = urlsplit_scheme(uri)
    if scheme not in ("", "file", "package"):
        raise DescriptionError([refusal(uri, scheme)])
    try:
        path = mesh_path(uri, base_dir)
        return path.resolve() if path.is_file() else None
    except (OneBotError, OSError, ValueError):
        return None


def urlsplit_scheme(uri: str) -> str:
    """Return the scheme of ``uri`` in lower case, "" if it is a path."""
    scheme, colon, _ = uri.partition(":")
    # One letter is a drive of another system, and a slash before the colon makes it a path.
    is_scheme = colon and len(scheme) > 1 and scheme.isascii() and scheme.isalnum()
    return scheme.lower() if is_scheme else ""


def refusal(uri: str, scheme: str) -> str:
    """Why a ``uri`` of this ``scheme`` is not loaded, and what to write."""
    fetched = "nothing is fetched from the network; " if scheme in ("http", "https", "ftp") else ""
    return (
        f'"{uri}": {scheme}:// is not loaded; {fetched}'
        "write package://<package>/<path>, file:///<path> or a path"
    )


def mesh_path(uri: str, base_dir: Path | None) -> Path:
    """Return the path that ``uri`` stands for, whether or not a file is there.

    Raises:
        OneBotError: it stands for none; the message says why and what to write.
    """
    scheme = urlsplit_scheme(uri)
    if uri.startswith(_PACKAGE):
        name, _, inner = uri[len(_PACKAGE) :].partition("/")
        if not name or not inner:
            raise OneBotError(f'"{uri}" must read package://<package>/<path>')
        return find_package(name, base_dir) / inner
    if scheme == "file":
        parts = urlsplit(uri)
        if parts.netloc not in ("", "localhost") or not parts.path.startswith("/"):
            raise OneBotError(f'"{uri}" must read file:///<absolute path>, with three slashes')
        return Path(unquote(parts.path))
    if scheme:
        raise OneBotError(refusal(uri, scheme))
    path = Path(uri)
    if path.is_absolute():
        return path
    if base_dir is None:
        raise OneBotError(
            f'"{uri}" is relative, but this text lies in no folder; '
            "write package://<package>/<path> or an absolute path"
        )
    return base_dir / path


def with_absolute_meshes(description: Description) -> str:
    """Return the URDF text with the filename of every mesh an absolute path.

    That is what PyBullet, Rerun and yourdfpy all understand alike. A filename that leads nowhere
    is left as it is.
    """
    root = ElementTree.fromstring(description.urdf)
    base = base_folder(description.source)
    for mesh in root.iter("mesh"):
        try:
            path = resolve_mesh(mesh.get("filename", ""), base)
        except DescriptionError:
            continue
        if path is not None:
            mesh.set("filename", str(path))
    return to_text(root)


def base_folder(source: str) -> Path | None:
    """Return the folder that relative paths in ``source`` start from; None if it is no file."""
    try:
        path = Path(source)
        return path.absolute().parent if path.is_file() else None
    except (OSError, ValueError):
        return None


def to_text(root: ElementTree.Element) -> str:
    """Return indented XML text, headed by an XML declaration without an encoding.

    Short lines matter: PyBullet breaks those of more than 8191 characters.
    """
    ElementTree.indent(root)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def is_ascii_stl(path: Path) -> bool:
    """Return whether ``path`` is an STL in its text form."""
    with path.open("rb") as file:
        head = file.read(84)
    if not head.lstrip().startswith(b"solid"):
        return False
    # Some binary files begin with "solid" too; their length gives them away.
    triangles = int.from_bytes(head[80:84], "little")
    return path.stat().st_size != 84 + 50 * triangles
