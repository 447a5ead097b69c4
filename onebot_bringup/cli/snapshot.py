"""``onebot snapshot``: draws a picture of a robot without any display."""

import argparse
import math
import os
import re
import tempfile
from argparse import Namespace
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from onebot_bringup.cli.options import Parser, assignment, flag, numbers, option, positional
from onebot_bringup.launch.arguments import split_ros_args, take_package_path
from onebot_description.atomic_write import refuse_unwritable, writing
from onebot_description.errors import OneBotError, UsageError
from onebot_description.geometry.poses import Triple
from onebot_description.ros.signals import KeyboardInterrupts


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code."""
    args = parse_command_line(argv)
    check_picture(args.file)
    if args.kind in ("rrd", "bag") and not os.path.exists(args.source):
        raise OneBotError(f"there is no recording {args.source}")
    if args.kind == "description":
        from onebot_description.description import load_description  # slower to import

        args.description = load_description(args.source, args.arguments)
    from onebot_bringup.cli.pictures import draw  # the slowest

    with KeyboardInterrupts(), tempfile.TemporaryDirectory(prefix="onebot-") as folder:
        draw(args, Path(folder) / "snapshot.rrd")
    print(f"wrote {args.file} ({args.width} x {args.height})")
    return 0


def check_picture(png: Path) -> None:
    """Reject a picture that cannot be written, before any work is done for it."""
    if png.suffix.lower() != ".png":
        raise OneBotError(f"{png}: a picture's name must end in .png")
    with writing(png):
        refuse_unwritable(png.with_name(f".{png.name}-{os.getpid()}"))  # the temporary file


# --- the command line -----------------------------------------------------------------------------

_SUMMARY = """\
draw robots into a PNG file, without any display: the running ones as they are now; or with
SOURCE, a URDF or xacro file at given joint positions, or the end of a recording (.rrd, .mcap, or a
folder of record:=). name:=value are arguments that the xacro file declares; of a recording of ROS
messages, namespace:= chooses one robot if several are recorded. package_path:= holds the
folders, joined by :, in which ROS packages are looked for first"""
_KINDS = {".rrd": "rrd", ".mcap": "bag", ".db3": "bag", ".zstd": "bag", ".bag": "bag"}
_NAMESPACE = "namespace"  # the only argument for a bag
_WIDTH, _HEIGHT = 1280, 720
# Sizes in pixels: the viewer's window cannot be smaller, and software rendering may fail beyond.
_SMALLEST, _LARGEST = 100, 4096


_pixels = numbers(
    int, lambda value: _SMALLEST <= value <= _LARGEST, f"from {_SMALLEST} to {_LARGEST}"
)


def camera(text: str) -> tuple[Triple, Triple | None]:
    """Return eye and target, meters in the fixed frame; no target if only the eye is given.

    Raises:
        ArgumentTypeError: the text is invalid, or eye and target are equal.
    """
    eye, colon, target = text.partition(":")
    with suppress(ValueError):
        place, at = _vector(eye), _vector(target) if colon else None
        if place != at and math.isfinite(sum(place + (at or ()))):
            return place, at
    form = "write x,y,z of the eye, or x,y,z:x,y,z with its target, another point (m)"
    raise argparse.ArgumentTypeError(f'"{text}": {form}')


def _vector(text: str) -> Triple:
    x, y, z = (float(word) for word in text.split(","))
    return x, y, z


OPTIONS = (
    option("file", "FILE.png", "the picture; an existing one is replaced", Path),
    positional("SOURCE", "what to draw (default: the running robot)", nargs="?"),
    option(
        "--joints",
        "NAME=VALUE",
        "positions in rad or m; 0 for the others, or mid-range where 0 is out of range",
        assignment,
        default=[],
        nargs="+",
        action="extend",
    ),
    option("--width", "PIXELS", f"({_WIDTH})", _pixels, _WIDTH),
    option("--height", "PIXELS", f"({_HEIGHT})", _pixels, _HEIGHT),
    option(
        "--camera",
        "X,Y,Z[:X,Y,Z]",
        "where to look from, and at, in meters in the fixed frame (default: the view's)",
        camera,
    ),
    flag("--dashboard", "the whole layout with its plots"),
    option(
        "--view",
        "FILE",
        "how to look at it: .yaml, .rviz or none (default: the view of its description)",
        default="",
    ),
)


def parse_command_line(argv: Sequence[str]) -> Namespace:
    """Return the options of the command; packages are also looked for in ``package_path:=``.

    Returns:
        file, source, kind (of the source: "running", "rrd", "bag" or "description"), joints (by
        name), width, height, camera (eye and target, or None), dashboard, view, arguments (by
        name; of xacro, or of a bag), namespace (of a bag) and ros_args.
    """
    parser = Parser("onebot snapshot", _SUMMARY, OPTIONS)
    parser.usage = "onebot snapshot FILE.png [SOURCE] [options] [name:=value ...]"
    words, _ = split_ros_args(argv)
    pairs = [word for word in words if re.match(r"[^-:][^:]*:=", word)]
    args = parser.parse([word for word in argv if word not in pairs])
    values = dict(word.split(":=", 1) for word in pairs)
    args.arguments = take_package_path(values)
    args.joints = dict(args.joints)
    args.kind = kind_of(args.source)
    own_names = {_NAMESPACE} if args.kind == "bag" else set()
    if args.kind != "description" and (args.joints or args.arguments.keys() - own_names):
        raise UsageError(
            "--joints and name:=value are for a URDF or xacro file as SOURCE; choose a running "
            "robot by --ros-args -r __ns:=/NAMESPACE"
        )
    args.namespace = args.arguments.get(_NAMESPACE, "")
    return args


def kind_of(source: str | None) -> str:
    """Return what ``source`` names: "running", "rrd", "bag" or "description"."""
    if source is None:
        return "running"
    if os.path.isdir(source):
        return "bag"  # whatever its name is, since record:=run.rrd also makes a folder
    return _KINDS.get(Path(source).suffix, "description")
