"""From a file or a text to a Description."""

import json
import os
import zlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from onebot_description.description import xml
from onebot_description.description.checks import (
    check_inertial,
    check_materials,
    check_meshes,
    check_mimics,
    check_root,
    check_schema,
    check_tree,
    named,
)
from onebot_description.description.description import Description, Sensor
from onebot_description.description.packages import package_share, resolve
from onebot_description.description.reading import (
    Findings,
    read_ends,
    read_joint,
    read_links,
    read_materials,
)
from onebot_description.description.ros2_control import read_interfaces
from onebot_description.description.sensors import read_sensors
from onebot_description.errors import (
    DescriptionError,
    OneBotError,
    condensed,
    did_you_mean,
    printable,
)

# The environment variable with a folder that says where the elements of each URDF were written: a
# bringup knows its files, and its nodes get the text alone.
PLACES = "ONEBOT_PLACES"
_WORLD = ".urdf.xacro"  # ending of the files of worlds that ship


def load_description(source: str | Path, arguments: Mapping[str, str] | None = None) -> Description:
    """Read a robot description, expand it if it is xacro, and check it.

    What is wrong but can be left out or replaced is in the ``problems`` of the description, as
    nodes take it with a warning; ``Description.raise_problems`` is the strict check.

    Args:
        source: a .urdf or .xacro file, or ``package://name/path``. A file that declares the xacro
            namespace is xacro whatever its name.
        arguments: values for its ``<xacro:arg>``s, by name.

    Raises:
        DescriptionError: the file cannot be read or expanded, an argument is not one it takes, or
            nothing of the robot can be published; all problems at once, each with file, line,
            element and remedy.
    """
    path = _locate(source)
    document, files, warnings = _read(path, arguments or {})
    return _check(document, str(path), files, warnings)


def _read(
    path: Path, arguments: Mapping[str, str]
) -> tuple[xml.Document, tuple[Path, ...], tuple[str, ...]]:
    """Return the document in a file, xacro expanded, the files read, and warnings."""
    values = {name: str(value) for name, value in arguments.items()}
    name = xml.shown_path(path)
    data, blank = xml.declaration_first(xml.read_bytes(path), name)
    document = xml.parse(data, name, path.parent)
    if document.has_xacro or path.suffix == ".xacro":
        from onebot_description.description.xacro import expand

        return expand(path, values)
    if values:
        names = ", ".join(sorted(values))
        raise DescriptionError([f"{name}: is plain URDF and takes no arguments (given: {names})"])
    return document, (path,), blank


class SensorFile(NamedTuple):
    """The sensors of a file, for a robot whose URDF lacks them."""

    sensors: tuple[Sensor, ...]
    bad_sensors: tuple[str, ...]  # names of unreadable sensors
    notices: tuple[str, ...]  # why, and warnings
    files: tuple[Path, ...]  # all files read


def load_sensors(source: str | Path, robot: Description) -> SensorFile:
    """Read a URDF or xacro file whose root holds ``<gazebo reference="LINK">`` blocks.

    Raises DescriptionError if it cannot be read or expanded, or holds no sensor.
    """
    path = _locate(source)
    document, files, warnings = _read(path, {})
    _drop_namespace(document)
    findings = Findings(document)
    sensors, bad = read_sensors(findings, robot.link_names, robot.joints)
    if not sensors and not bad:
        text = 'holds no sensor; write <robot><gazebo reference="LINK"><sensor name="" type="">'
        raise DescriptionError([f"{document.shown}: {text}"])
    notices = (*map(printable, warnings), *findings.of("problem", "warning"))
    return SensorFile(sensors, bad, condensed(notices), files)


def load_world(world: str) -> Description:
    """Read and check the description of a world.

    It is named by its name, such as "maze", if it ships; else as ``load_description`` has it.
    """
    worlds = shipped_worlds()
    if world in worlds:
        return load_description(worlds[world])
    if "/" not in world and "." not in world and not Path(world).is_file():
        raise OneBotError(
            f'no world "{world}"{did_you_mean(world, worlds, "those that ship")}; write one of '
            "these, or the path of a URDF or xacro file"
        )
    description = load_description(world)
    description.require_tree()
    return description


def shipped_worlds() -> dict[str, Path]:
    """Return the files of the worlds that ship, by name."""
    files = (package_share("onebot_description") / "worlds").glob(f"*{_WORLD}")
    return {file.name.removesuffix(_WORLD): file for file in sorted(files)}


def parse_description(urdf: str, name: str = "<string>") -> Description:
    """Read and check URDF text, such as a parameter holds; xacro is not expanded.

    Args:
        urdf: the text. An encoding it declares is ignored, being text already. Messages have the
            lines of the files that a bringup has made it of, where that is known.
        name: what to call it in messages. If it is the path of a file, relative mesh paths start
            from that file's folder.

    Raises:
        DescriptionError: nothing of the robot can be published; all problems at once.
    """
    try:
        data, blank = xml.declaration_first(urdf.encode("utf-8"), name)
    except UnicodeEncodeError as error:
        raise DescriptionError([f"{name}: holds a character that is none ({error})"]) from None
    document = xml.parse(data, name, _folder(name), "utf-8")
    places = _kept_places(urdf)
    if len(places) == len(document.places):
        document.places.update(zip(document.root.iter(), places, strict=True))
    files = (Path(name).absolute(),) if document.folder is not None else ()
    return _check(document, name, files, blank)


def keep_places(description: Description) -> None:
    """Have processes that get the description's text know where it was written, if they can."""
    if file := _places_file(description.urdf):
        with suppress(OSError):  # the folder is temporary
            file.write_text(json.dumps(description.places))


def _kept_places(urdf: str) -> list[str]:
    """Return where each element of a text was written; none if that is not known."""
    try:
        file = _places_file(urdf)
        return list(json.loads(file.read_text())) if file else []
    except (OSError, UnicodeEncodeError):
        return []


def _places_file(urdf: str) -> Path | None:
    folder = os.environ.get(PLACES)
    return Path(folder, f"{len(urdf):x}-{zlib.crc32(urdf.encode()):08x}") if folder else None


def _folder(name: str) -> Path | None:
    """The folder of the file ``name``; None if it is no file."""
    try:
        path = Path(name)
        return path.absolute().parent if path.is_file() else None
    except (OSError, ValueError):
        return None


def _locate(source: str | Path) -> Path:
    """The absolute path that ``source`` names."""
    text = os.fspath(source)
    if not text:
        raise DescriptionError(["no robot description given; name a .urdf or .xacro file"])
    try:
        if text.startswith("package://"):
            return resolve(text, None)
        return Path(text).expanduser().absolute()
    except (OneBotError, RuntimeError) as error:
        raise DescriptionError([f"{text}: {error}"]) from None


def _check(
    document: xml.Document, source: str, files: tuple[Path, ...], warnings: tuple[str, ...]
) -> Description:
    """Check a parsed document and return what can be used of it."""
    _drop_namespace(document)
    findings = Findings(document)
    check_root(findings)
    links, elements = named(findings, "link"), named(findings, "joint")
    ends = read_ends(findings, elements, links)
    root_link = check_tree(findings, elements, links, ends)
    joints = {
        name: read_joint(findings, name, element, ends.get(name))
        for name, element in elements.items()
    }
    for name in check_mimics(findings, joints, elements):
        joints[name] = replace(joints[name], mimic=None)
    materials = read_materials(findings)
    link_elements = read_links(findings, materials)
    check_meshes(findings)
    for element, link in link_elements.items():
        if link.inertial is not None:
            check_inertial(findings, element, link.inertial)
    check_materials(findings, materials)
    check_schema(findings)
    sensors, bad_sensors = read_sensors(findings, links, joints.values())
    interfaces = read_interfaces(findings, joints)
    findings.raise_errors(warnings)
    return Description(
        urdf=xml.to_text(findings.document.root),
        robot_name=findings.document.root.get("name", ""),
        source=source,
        files=files,
        root_link=root_link,
        links=tuple(link_elements[element] for element in links.values()),
        joints=tuple(joints.values()),
        problems=condensed(findings.of("problem")),
        warnings=condensed([*map(printable, warnings), *findings.of("warning")]),
        places=tuple(map(findings.where, document.root.iter())),
        sensors=sensors,
        bad_sensors=bad_sensors,
        interfaces=interfaces,
    )


def _drop_namespace(document: xml.Document) -> None:
    """Undo a default namespace (``<robot xmlns="...">``), which other programs do not read."""
    tag = document.root.tag
    if tag.startswith("{") and tag.endswith("}robot"):
        prefix = tag[: -len("robot")]
        for element in document.root.iter():
            if element.tag.startswith(prefix):
                element.tag = element.tag[len(prefix) :]
