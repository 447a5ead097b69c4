"""From a file or a text to a checked Description."""

import os
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

from onebot_description.description import xml
from onebot_description.description.checks import (
    check_link,
    check_materials,
    check_mimics,
    check_root,
    check_schema,
    check_tree,
    named,
    read_ends,
    read_joint,
)
from onebot_description.description.description import Description, Report
from onebot_description.description.meshes import (
    base_folder,
    mesh_path,
    to_text,
    with_absolute_meshes,
)
from onebot_description.errors import DescriptionError, OneBotError

# The URDF text that others get to see.


def published_urdf(description: Description) -> str:
    """Return the URDF text to hand to robot_state_publisher.

    A text has no folder that the relative path of a mesh could start from, so such become absolute.
    """
    meshes = ElementTree.fromstring(description.urdf).iter("mesh")
    if any(_is_relative(mesh.get("filename", "")) for mesh in meshes):
        return with_absolute_meshes(description)
    return description.urdf


def _is_relative(uri: str) -> bool:
    return ":" not in uri and not uri.startswith("/")


def load_description(source: str | Path, arguments: Mapping[str, str] | None = None) -> Description:
    """Read a robot description, expand it if it is xacro, and check it.

    Args:
        source: a .urdf or .xacro file, or ``package://name/path``. A file that declares the xacro
            namespace is xacro whatever its name.
        arguments: values for its ``<xacro:arg>``s, by name.

    Returns:
        What the file says, with warnings about what is probably not meant.

    Raises:
        DescriptionError: the file cannot be read or expanded, an argument is not one it takes, or
            the robot is broken; all problems at once, each with file, line, element and remedy.
    """
    path = _locate(source)
    given = {name: str(value) for name, value in (arguments or {}).items()}
    data = xml.read_bytes(path)
    shown = xml.shown_path(path)
    found = xml.scan(data, shown)
    if found.has_xacro or path.suffix == ".xacro":
        from onebot_description.description.xacro import expand

        document, files, warnings = expand(path, given)
        return _check(document, str(path), files, warnings)
    if given:
        names = ", ".join(sorted(given))
        raise DescriptionError([f"{shown}: is plain URDF and takes no arguments (given: {names})"])
    document = xml.to_document(data, found, shown, path.parent)
    return _check(document, str(path), (path,), ())


def parse_description(urdf: str, name: str = "<string>") -> Description:
    """Check URDF text, such as a parameter holds; xacro is not expanded.

    Args:
        urdf: the text. An encoding it declares is ignored, being text already.
        name: what to call it in messages. If it is the path of a file, relative mesh paths start
            from that file's folder.

    Raises:
        DescriptionError: all problems at once.
    """
    try:
        data = urdf.encode("utf-8")
    except UnicodeEncodeError as error:
        raise DescriptionError([f"{name}: holds a character that is none ({error})"]) from None
    if not data.strip():
        raise DescriptionError([f'{name}: is empty; it should hold <robot name="...">'])
    found = xml.scan(data, name, "utf-8")
    document = xml.to_document(data, found, name, base_folder(name), "utf-8")
    files = (Path(name).absolute(),) if document.base is not None else ()
    return _check(document, name, files, ())


def _locate(source: str | Path) -> Path:
    """The absolute path that ``source`` names."""
    text = os.fspath(source)
    if not text:
        raise DescriptionError(["no robot description given; name a .urdf or .xacro file"])
    try:
        if text.startswith("package://"):
            return mesh_path(text, None)
        return Path(text).expanduser().absolute()
    except (OneBotError, RuntimeError) as error:
        raise DescriptionError([f"{text}: {error}"]) from None


def _check(
    document: xml.Document, source: str, files: tuple[Path, ...], warnings: tuple[str, ...]
) -> Description:
    """Check a parsed document and say what it holds."""
    _drop_namespace(document)
    report = Report(document)
    report.warnings.extend(warnings)
    check_root(report)
    links, elements = named(report, "link"), named(report, "joint")
    ends = read_ends(report, elements, links)
    root_link = check_tree(report, elements, links, ends)
    joints = {
        name: read_joint(report, name, element, ends.get(name))
        for name, element in elements.items()
    }
    check_mimics(report, joints, elements)
    for link in document.root.findall("link"):
        check_link(report, link)
    check_materials(report)
    check_schema(report)
    report.raise_if_any()
    return Description(
        urdf=to_text(document.root),
        robot_name=document.root.get("name", ""),
        source=source,
        files=files,
        root_link=root_link,
        links=tuple(links),
        joints=tuple(joints.values()),
        warnings=tuple(report.warnings),
    )


def _drop_namespace(document: xml.Document) -> None:
    """Undo a default namespace (``<robot xmlns="...">``), which the other readers stumble over."""
    tag = document.root.tag
    if tag.startswith("{") and tag.endswith("}robot"):
        prefix = tag[: -len("robot")]
        for element in document.root.iter():
            if element.tag.startswith(prefix):
                element.tag = element.tag[len(prefix) :]
