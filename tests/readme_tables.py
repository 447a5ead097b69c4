"""Writes the tables of parameters and arguments: ``python -m tests.readme_tables``.

They are made from the declarations, which also give the nodes' descriptors, ``--help`` and
``--show-args``; a test compares them.
"""

import re
from collections.abc import Iterable, Iterator, Sequence

from onebot_bringup.bags.bag_recorder import RecorderParameters
from onebot_bringup.cli.verbs import VERBS, subcommands
from onebot_bringup.launch.arguments import Argument
from onebot_bringup.launch.settings import BringupSettings, StandingSettings
from onebot_bringup.steering.page_parameters import PageParameters
from onebot_bringup.viewer.view_config import ViewConfig
from onebot_bringup.viewer.viewer_parameters import ViewerParameters
from onebot_control.drive_kinds import ControlConfig
from onebot_control.navigation.parameters import NavigatorParameters
from onebot_control.trajectories.config import TrajectoryConfig
from onebot_control.trajectories.forwarding import ForwardConfig
from onebot_control.trajectories.gripping import GripperConfig
from onebot_description.joints.config import JointsConfig
from onebot_description.parameters.reader import leaves, rows
from onebot_description.ros.wire.interface_text import KINDS, definitions
from onebot_description.state_parameters import StateParameters
from tests.onebot_control.drive_models import MECANUM, OMNI, STEERING, TRICYCLE
from tests.readme import CHECKOUT, documents

PARAMETERS: dict[str, tuple[type, ...]] = {  # of each node
    "robot_state_publisher": (StateParameters,),
    "joint_state_publisher": (JointsConfig,),
    "velocity_controller": (ControlConfig,),
    "mecanum_drive_controller": (MECANUM,),
    "omni_wheel_drive_controller": (OMNI,),
    "ackermann_steering_controller": (STEERING,),
    "tricycle_controller": (TRICYCLE,),
    "joint_trajectory_controller": (TrajectoryConfig,),
    "forward_command_controller": (ForwardConfig,),
    "navigator": (NavigatorParameters,),
    "parallel_gripper_action_controller": (GripperConfig,),
    "rerun_viewer": (ViewerParameters, ViewConfig),
    "steering_page": (PageParameters,),
    "bag_recorder": (RecorderParameters,),
}
ROOM = CHECKOUT / "onebot_description/ros/packages"
_WITHOUT_EFFECT = "accepted, without effect"
_ROBOTS_OWN = "the robot's"  # default of a file that each bringup has of its own


def tables() -> dict[str, str]:
    """Return each table by the name in its marks."""
    by_name = {f"parameters of {name}": _parameters(*kinds) for name, kinds in PARAMETERS.items()}
    by_name["commands"] = _table(("Command", "Purpose"), map(_verb, VERBS))
    own = dict.fromkeys(("model", "joints", "view"), _ROBOTS_OWN)
    drives = BringupSettings.arguments(**own, params_file="`control.yaml`")
    stands = StandingSettings.arguments(**own)
    common = [argument.name for argument in drives].index("sim")
    by_name["arguments"] = _arguments(drives[:common])
    by_name["arguments of onebot_bringup"] = _arguments(drives[common:])
    by_name["arguments of mrm_bringup"] = _arguments(stands[common:])
    by_name["packages of interfaces"] = _interfaces()
    return by_name


def _interfaces() -> str:
    """Return the table of the interface packages here: version, and how many of each kind."""
    versions = dict(line.split() for line in (ROOM / "versions.txt").read_text().splitlines())
    packages = sorted(folder for folder in ROOM.iterdir() if any(definitions(folder)))
    counts = {
        folder.name: [str(len([*definitions(folder, [kind])]) or "") for kind in KINDS]
        for folder in packages
    }
    cells = ((f"`{name}`", versions[name], *kinds) for name, kinds in counts.items())
    return _table(("Package", "Version", "Messages", "Services", "Actions"), cells)


def _parameters(*kinds: type) -> str:
    """Return the table of a node; of a drive other than velocity_controller's, what differs.

    A sentence below it names the parameters that are accepted without effect.
    """
    known = {} if ControlConfig in kinds else {leaf.name: leaf for leaf in leaves(ControlConfig)}
    shown = [
        row
        for row in rows(*kinds)
        if not known.keys() >= {*row.names} or known[row.names[0]].default_text != row.default
    ]
    idle = [name for row in shown if _WITHOUT_EFFECT in row.meaning for name in row.names]
    cells = (
        (_names(row.names), row.type, _code(row.default), _plain(row.meaning))
        for row in shown
        if _WITHOUT_EFFECT not in row.meaning
    )
    table = _table(("Parameter", "Type", "Default", "Meaning"), cells)
    return f"{table}\n\nAccepted, without effect: {_names(idle)}." if idle else table


def _arguments(arguments: Iterable[Argument]) -> str:
    cells = ((f"`{one.name}`", _code(one.default), _plain(one.help)) for one in arguments)
    return _table(("Argument", "Default", "Meaning"), cells)


def _verb(name: str) -> tuple[str, str]:
    first, *others = [*subcommands(name)] or [""]
    return _names([f"onebot {name} {first}".rstrip(), *others]), VERBS[name].summary


def _names(names: Iterable[str]) -> str:
    """Return names for a cell: `{a, b}.x` for `a.x` and `b.x`."""
    ends: dict[str, list[str]] = {}
    for name in names:
        group, _, end = name.rpartition(".")
        ends.setdefault(group, []).append(end)
    cells = [f"`{end}`" for end in ends.pop("", [])]
    groups: dict[tuple[str, ...], list[str]] = {}
    for group, names_in_it in ends.items():
        groups.setdefault(tuple(names_in_it), []).append(group)
    cells += [f"`{_braces(alike)}.{_braces(last)}`" for last, alike in groups.items()]
    return ", ".join(cells)


def _braces(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{{{', '.join(words)}}}"


def _code(default: str) -> str:
    return default if default in ("", "required", _ROBOTS_OWN) or "`" in default else f"`{default}`"


def _plain(sentence: str) -> str:
    return sentence.replace("<", r"\<")


def _table(head: tuple[str, ...], cells: Iterable[tuple[str, ...]]) -> str:
    lines = (" | ".join(cell.replace("|", r"\|") for cell in row) for row in (head, *cells))
    first, *others = (f"| {line} |" for line in lines)
    return "\n".join((first, "|---" * len(head) + "|", *others))


def rewritten(text: str) -> str:
    """Return a document with its tables made anew."""
    for name, table in tables().items():
        marked = rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)"
        text = re.sub(marked, lambda m, t=table: f"{m[1]}{t}\n{m[2]}", text, flags=re.DOTALL)
    return text


def readmes() -> Iterator[tuple[str, str]]:
    """Yield the path of each document, in the checkout, and its text."""
    for file in documents():
        yield str(file.relative_to(CHECKOUT)), file.read_text()


if __name__ == "__main__":
    for path, text in readmes():
        (CHECKOUT / path).write_text(rewritten(text))
