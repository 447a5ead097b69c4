"""Loads a Description from a file or a text, and sensors and worlds from files."""

import json
import os
import zlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated, NamedTuple

from onebot_description.description.checks import (
    check_materials,
    check_meshes,
    check_mimics,
    check_root,
    check_schema,
    check_tree,
    named,
)
from onebot_description.description.drive_elements import read_drive_plugin, read_rollers
from onebot_description.description.physics_elements import LinkPhysics, read_physics
from onebot_description.description.ros2_control import read_interfaces
from onebot_description.description.sensors.sensor_reader import read_sensors
from onebot_description.elements import xml
from onebot_description.elements.packages import package_share, resolve
from onebot_description.elements.reading import (
    Findings,
    read_ends,
    read_joint,
    read_links,
    read_materials,
)
from onebot_description.elements.sensor import Sensor
from onebot_description.elements.urdf import Description, Link
from onebot_description.errors import (
    DescriptionError,
    OneBotError,
    condensed,
    did_you_mean,
    printable,
    shortened,
)
from onebot_description.parameters.arguments import checked
from onebot_description.parameters.values import Rule

# Environment variable: a folder with file and line of the elements of each URDF. A bringup reads
# the files; its nodes get only the text, but should name these places in their messages.
PLACES = "ONEBOT_PLACES"
_WORLD = ".urdf.xacro"  # ending of the files of included worlds
_GENERATED = "clutter"  # the kind of world that is generated

XacroValues = Annotated[
    Mapping[str, str | float | bool], Rule(write="a dict of values by the names of <xacro:arg>s")
]
"""Values of xacro arguments by name; xacro gets them as text."""

_Source = Annotated[str | Path, Rule(write="the path of a URDF or xacro file")]


@checked
def load_description(source: _Source, arguments: XacroValues | None = None) -> Description:
    """Read a robot description, expand it if it is xacro, and check it.

    Faulty elements that can be left out or replaced are listed in the description's ``problems``.
    Nodes only warn about them; ``Description.raise_problems`` is the strict check.

    Args:
        source: a .urdf or .xacro file, or ``package://name/path``. A file that declares the xacro
            namespace is xacro whatever its name.
        arguments: values for its ``<xacro:arg>``s, by name.

    Raises:
        DescriptionError: the file cannot be read or expanded, it does not declare an argument, or
            the robot cannot be published. The text lists all problems, each with file, line,
            element and how to fix it.
    """
    path = _locate(source)
    document, files, warnings = _read(path, arguments or {})
    return _check(document, str(path), files, warnings)


def _read(
    path: Path, arguments: XacroValues
) -> tuple[xml.Document, tuple[Path, ...], tuple[str, ...]]:
    """Return the document in a file (expanded, if xacro), the files read, and warnings."""
    values = {name: str(value) for name, value in arguments.items()}
    name = xml.shown_path(path)
    data, warnings = xml.mended(xml.read_bytes(path), name)
    document = None if path.suffix == ".xacro" else xml.parse(data, name, path.parent)
    if document is None or document.has_xacro:
        from onebot_description.description.xacro import expand

        return expand(path, values)
    if values:
        names = ", ".join(sorted(values))
        raise DescriptionError([f"{name}: is plain URDF and takes no arguments (given: {names})"])
    return document, (path,), warnings


class SensorFile(NamedTuple):
    """The sensors in a file, for a robot whose URDF lacks them."""

    sensors: tuple[Sensor, ...]
    bad_sensors: tuple[str, ...]  # names of unreadable sensors
    notices: tuple[str, ...]  # why they are unreadable, and warnings
    files: tuple[Path, ...]  # all files read


def load_sensors(source: str | Path, robot: Description) -> SensorFile:
    """Read sensors from a URDF or xacro file with ``<gazebo reference="LINK">`` blocks.

    Args:
        source: the file, or ``package://name/path``.
        robot: the robot with the links that the blocks refer to.

    Raises:
        DescriptionError: the file cannot be read or expanded, or has no sensor.
    """
    path = _locate(source)
    document, files, warnings = _read(path, {})
    _drop_namespace(document)
    findings = Findings(document)
    sensors, bad = read_sensors(findings, robot.link_names, robot.joints)
    if not sensors and not bad:
        text = 'holds no sensor; write <robot><gazebo reference="LINK"><sensor name="" type="">'
        raise DescriptionError([f"{document.shown}: {text}"])
    notices = (*map(printable, warnings), *findings.by_severity("problem", "warning"))
    return SensorFile(sensors, bad, condensed(notices), files)


def load_world(world: str) -> Description:
    """Read and check the description of a world.

    Args:
        world: the name of an included world, such as "maze", a generated one, such as "clutter" or
            "clutter:seed=7,density=0.25" (see ``clutter``), or a file as for ``load_description``.

    Raises:
        OneBotError: there is no such world, or it cannot be read.
    """
    worlds = shipped_worlds()
    if world in worlds:
        return load_description(worlds[world])
    if world.partition(":")[0] == _GENERATED:
        from onebot_description.description.clutter import clutter, parameters_of

        return parse_description(clutter(parameters_of(world)).urdf, world)
    if "/" not in world and "." not in world and not Path(world).is_file():
        raise OneBotError(
            f'no world "{world}"'
            f"{did_you_mean(world, [_GENERATED, *worlds], 'included')}; write one of these, "
            "or the path of a URDF or xacro file"
        )
    description = load_description(world)
    description.require_tree()
    return description


def shipped_worlds() -> dict[str, Path]:
    """Return the files of the included worlds, by name."""
    files = (package_share("onebot_description") / "worlds").glob(f"*{_WORLD}")
    return {file.name.removesuffix(_WORLD): file for file in sorted(files)}


@checked
def parse_description(urdf: str, name: str = "<string>") -> Description:
    """Read and check URDF text, such as the parameter robot_description; xacro is not expanded.

    Args:
        urdf: the text; an encoding that it declares is ignored. If a bringup created it from files,
            messages name their lines.
        name: name of the text in messages. If it is the path of a file, relative mesh paths start
            from that file's folder.

    Raises:
        DescriptionError: the robot cannot be published; the text lists all problems.
    """
    # Characters that UTF-8 cannot encode are rejected like any others that XML does not allow.
    data, warnings = xml.mended(urdf.encode("utf-8", "surrogatepass"), name)
    document = xml.parse(data, name, _folder(name), "utf-8")
    places = _kept_places(urdf)
    if len(places) == len(document.places):
        document.places.update(zip(document.root.iter(), places, strict=True))
    files = (Path(name).absolute(),) if document.folder is not None else ()
    return _check(document, name, files, warnings)


def keep_places(description: Description) -> None:
    """Save file and line of a description's elements, for processes that get only its text."""
    if file := _places_file(description.urdf):
        with suppress(OSError):  # the folder is temporary
            file.write_text(json.dumps(description.places))


def _kept_places(urdf: str) -> list[str]:
    """Return where each element of a text was written; empty if that is not known."""
    try:
        file = _places_file(urdf)
        return list(json.loads(file.read_text())) if file else []
    except OSError:
        return []


def _places_file(urdf: str) -> Path | None:
    folder = os.environ.get(PLACES)
    return Path(folder, f"{len(urdf):x}-{zlib.crc32(urdf.encode()):08x}") if folder else None


def _folder(name: str) -> Path | None:
    """Return the folder of the file ``name``; None if it is not a file."""
    try:
        path = Path(name)
        return path.absolute().parent if path.is_file() else None
    except (OSError, ValueError):
        return None


def _locate(source: str | Path) -> Path:
    """Return the absolute path that ``source`` names."""
    text = os.fspath(source)
    if text.lstrip().startswith("<"):
        raise DescriptionError([f"{shortened(text)}: is a description; pass the path of its file"])
    try:
        if text.startswith("package://"):
            return resolve(text, None)
        return Path(text).expanduser().absolute()
    except (OneBotError, RuntimeError) as error:
        raise DescriptionError([f"{text}: {error}"]) from None


def _check(
    document: xml.Document, source: str, files: tuple[Path, ...], warnings: tuple[str, ...]
) -> Description:
    """Check a parsed document, and return its usable part as a Description."""
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
    check_materials(findings, materials)
    check_schema(findings)
    sensors, bad_sensors = read_sensors(findings, links, joints.values())
    interfaces = read_interfaces(findings, joints)
    drive_plugin = read_drive_plugin(findings, joints)
    rollers = read_rollers(findings, links, joints.values())
    physics = read_physics(findings, links, joints, rollers.elements)
    findings.raise_errors(warnings)
    return Description(
        urdf=xml.to_text(findings.document.root),
        robot_name=findings.document.root.get("name", ""),
        source=source,
        files=files,
        root_link=root_link,
        links=tuple(
            _with_physics(link_elements[element], physics.get(name))
            for name, element in links.items()
        ),
        joints=tuple(joints.values()),
        problems=condensed(findings.by_severity("problem")),
        warnings=condensed([*map(printable, warnings), *findings.by_severity("warning")]),
        places=tuple(map(findings.where, document.root.iter())),
        sensors=sensors,
        bad_sensors=bad_sensors,
        interfaces=interfaces,
        rollers=rollers.angles,
        drive_plugin=drive_plugin,
    )


def _with_physics(link: Link, physics: LinkPhysics | None) -> Link:
    return replace(link, gravity=physics.gravity, mu=physics.friction) if physics else link


def _drop_namespace(document: xml.Document) -> None:
    """Remove a default namespace (``<robot xmlns="...">``), which other programs cannot read."""
    tag = document.root.tag
    if tag.startswith("{") and tag.endswith("}robot"):
        prefix = tag[: -len("robot")]
        for element in document.root.iter():
            if element.tag.startswith(prefix):
                element.tag = element.tag[len(prefix) :]
