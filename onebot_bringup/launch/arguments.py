"""Parses and checks ``name:=value`` arguments, like roslaunch's.

If an argument is given twice, the last one wins, so that a script can put ``"$@"`` after its own
defaults. The words after ``--ros-args`` are separate, for every node.
"""

import os
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from onebot_bringup.steering.page_parameters import PageParameters
from onebot_bringup.viewer.core.settings import FrameSettings
from onebot_bringup.viewer.viewer_parameters import ViewerParameters
from onebot_control.conventions import DRIVE_CONTROLLER, MANAGER, namespace_prefix
from onebot_description.elements.packages import PACKAGE_PATH, use_package_path
from onebot_description.errors import OneBotError, UsageError, did_you_mean, printable
from onebot_description.parameters.reader import leaves
from onebot_description.parameters.values import Rule, ValueType
from onebot_description.ros.discovery import ARGUMENT, LOCALHOST, MAX_DOMAIN, WANTED
from onebot_description.state_parameters import StateParameters

if TYPE_CHECKING:
    from onebot_description.description.xacro import XacroArgument

# Arguments of other ROS launch files, with hints how to write them here.
_VIEWER = "write viewer:=web, viewer:=native or viewer:=none"
_SLIDERS = "joints move as joints:=FILE says, without sliders; joint_states:=false: not at all"
_VIEW = "what the viewer shows is in view:=FILE"
_FORMER = {
    "gui": f"{_VIEWER} for the view; {_SLIDERS}",
    **dict.fromkeys(("use_gui", "jsp_gui"), _SLIDERS),
    **dict.fromkeys(("rviz", "use_rviz", "launch_rviz", "headless"), _VIEWER),
    **dict.fromkeys(("rvizconfig", "rviz_config", "rviz_config_file"), _VIEW),
    "tf_prefix": "write frame_prefix:=PREFIX/",
}
_TRUE = ("true", "1")
_FALSE = ("false", "0")
_SWITCH = (*_TRUE, *_FALSE)
_OPTIONS = {"-h": "help", "--help": "help", "--show-args": "show", "-s": "show"}


@dataclass(frozen=True)
class Argument:
    """One launch argument."""

    name: str  # the word before :=
    default: str  # the text after :=; if it is empty, the user may leave the argument empty, too
    description: str  # one line
    type: ValueType = ValueType(str)  # the type that its text must be a value of
    examples: tuple[str, ...] = ()  # other values, for tab completion
    node: str = ""  # the node with the parameter that it sets; "" for none
    parameter: str = ""  # the name of that parameter

    @property
    def choices(self) -> Sequence[str]:
        """The allowed values; empty if any is allowed."""
        return _SWITCH if self.type.base is bool else self.type.rule.choices

    @property
    def help(self) -> str:
        """The description with the range or the choices, except for true and false."""
        if self.choices and self.type.base is not bool:
            return f"{self.description} ({', '.join(self.choices)})"
        limits = self.type.rule.range if self.type.rule.at_most is not None else ""
        return f"{self.description}; {limits}" if limits else self.description

    @property
    def suggested(self) -> Sequence[str]:
        """The values that tab completion offers."""
        if self.type.base is bool:
            return _TRUE[0], _FALSE[0]
        return self.choices or self.examples or ("",)

    def problem(self, text: str) -> str:
        """Return what is wrong with the value ``text``, and what would be right; "" if valid."""
        if not (text or self.default):
            return ""
        if self.choices and text not in self.choices:
            return self._not_possible(text, f"it can be one of: {', '.join(self.choices)}")
        if self.type.many:
            return ""  # the node checks a list
        try:
            self.type.checked(self.value(text))
        except ValueError:
            return self._not_possible(text, f"write {self.type.wanted()}")
        return ""

    def value(self, text: str) -> Any:
        """Return ``text`` as a value of the argument's type, or unchanged if it is not one."""
        if self.type.many:
            return [part.strip() for part in text.split(",")]
        if self.type.base is bool:
            return text in _TRUE
        with suppress(ValueError):
            return self.type.base(text)
        return text

    def _not_possible(self, text: str, possible: str) -> str:
        return f"{self.name}:={text} is not possible; {possible}"


def switch(name: str, default: bool, description: str) -> Argument:
    """Return an argument that is true or false."""
    return Argument(name, _text(default), description, ValueType(bool))


def choice(name: str, default: str, description: str, choices: tuple[str, ...]) -> Argument:
    """Return an argument that is one of some words."""
    return Argument(name, default, description, ValueType(str, Rule(choices=choices)))


def number(
    name: str,
    default: str,
    description: str,
    at_least: float | None = None,
    at_most: float | None = None,
    kind: type = float,
) -> Argument:
    """Return an argument that is a finite number, or with ``kind=int`` an integer."""
    value = ValueType(kind, Rule(at_least=at_least, at_most=at_most))
    return Argument(name, default, description, value)


def parameters_of(node: str, kind: type, *names: str) -> list[Argument]:
    """Return arguments that set the parameters of the same names; see ``parameter_of``."""
    return [parameter_of(node, kind, name) for name in names]


def parameter_of(
    node: str,
    kind: type,
    parameter: str,
    name: str = "",
    *,
    default: str | None = None,
    note: str = "",
    examples: tuple[str, ...] = (),
) -> Argument:
    """Return an argument that sets a parameter and has its type, range and description.

    Args:
        node: the name of the node with the parameter.
        kind: the dataclass that declares the parameter.
        parameter: the name of the parameter.
        name: the name of the argument, if it differs.
        default: the default of the argument, if it differs.
        note: added to the description.
        examples: other values, for tab completion.
    """
    [leaf] = [leaf for leaf in leaves(kind) if leaf.name == parameter]
    joined = "joined by commas" if leaf.type.many else ""
    return Argument(
        name or parameter,
        _text(leaf.default) if default is None else default,
        "; ".join(filter(None, (leaf.type.rule.description, joined, note))),
        leaf.type,
        examples,
        node,
        parameter,
    )


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def node_parameters(
    arguments: Iterable[Argument], values: Mapping[str, str], node: str
) -> dict[str, object]:
    """Return the arguments that are parameters of a node, except empty ones."""
    return {
        argument.parameter: argument.value(values[argument.name])
        for argument in arguments
        if argument.node == node and values[argument.name]
    }


@dataclass(frozen=True)
class Arguments:
    """A command line split into its parts, before the names are checked."""

    given: Mapping[str, str]  # values of all name:=value, by name
    positional: tuple[str, ...]  # words of any other form
    ros_args: tuple[str, ...]  # the words after --ros-args
    help: bool  # --help was given
    show: bool  # --show-args was given


def split(argv: Sequence[str]) -> Arguments:
    """Split a command line into its parts."""
    words, ros_args = _split_ros_args(argv)
    assignments: dict[str, str] = {}
    positional: list[str] = []
    options: set[str] = set()
    for word in words:
        name, separator, value = word.partition(":=")
        if separator and not name.startswith("-"):
            assignments[name] = os.path.expanduser(value)  # shells leave the ~ of ``name:=~/x``
        elif word.startswith("-") and word != "-":
            options.add(_OPTIONS.get(word) or _refuse_option(word))
        else:
            positional.append(word)
    return Arguments(assignments, tuple(positional), ros_args, "help" in options, "show" in options)


def _split_ros_args(argv: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Split off ``--ros-args ... [--]``."""
    words = list(argv)
    if "--ros-args" not in words:
        return words, ()
    start = words.index("--ros-args")
    end = words.index("--", start) if "--" in words[start:] else len(words)
    return words[:start] + words[end + 1 :], tuple(words[start + 1 : end])


def _refuse_option(word: str) -> NoReturn:
    bare = word.lstrip("-").partition(":=")[0].partition("=")[0]
    raise UsageError(
        f'no option "{word}" (options: --help, --show-args, --ros-args); '
        f"launch arguments are written {bare or 'name'}:=value"
    )


def refuse_positional(words: Sequence[str]) -> None:
    """Reject words other than ``name:=value``, for a command that takes none."""
    if words:
        name, equals, value = words[0].partition("=")
        meant = f"{name}:={value}" if equals else "name:=value"
        raise UsageError(f'unexpected "{words[0]}"; arguments are written {meant}')


def with_positional(arguments: Arguments, name: str, what: str, program: str) -> dict[str, str]:
    """Return the given arguments, with the one word without ``:=`` as the argument ``name``.

    Args:
        arguments: the command line.
        name: the argument that the word stands for.
        what: what the word is, such as "file", for errors.
        program: the program, for errors.

    Raises:
        UsageError: there are several words, or both a word and the argument.
    """
    refuse_positional(arguments.positional[1:])
    if arguments.positional and name in arguments.given:
        raise UsageError(f"write the {what} or {name}:=, not both, for {program}")
    return {**dict(zip([name], arguments.positional, strict=False)), **arguments.given}


def require_file(name: str, path: Path, instead: str = "") -> None:
    """Raise a OneBotError if the file that an argument names does not exist.

    Args:
        name: the argument.
        path: the file.
        instead: what to write, for the message.
    """
    if not path.is_file():
        raise OneBotError(f"{name}:={path}: no such file{instead}")


def complete(declared: Iterable[Argument], given: Mapping[str, str]) -> dict[str, str]:
    """Return a value for each declared argument: the given one, or its default.

    Switches become ``true`` or ``false``, however they were written.
    """
    arguments = {argument.name: argument for argument in declared}
    problems = [unknown(name, arguments) for name in given if name not in arguments]
    values = {}
    for name, argument in arguments.items():
        value = given.get(name, argument.default)
        if argument.type.base is bool:
            value = _switch_value(value)
        problems.append(argument.problem(value))
        values[name] = value
    if any(problems):
        raise UsageError("\n".join(filter(None, problems)))
    return values


def unknown(name: str, names: Iterable[str]) -> str:
    """Return the message about an argument that does not exist."""
    if name in _FORMER:
        return f'no argument "{name}": {_FORMER[name]}'
    return f'no argument "{name}"{did_you_mean(name, names, "arguments")}'


def _switch_value(value: str) -> str:
    lower = value.lower()
    return "true" if lower in _TRUE else "false" if lower in _FALSE else value


listed: list[Argument] = []  # printed by this process, for tab completion


def table(arguments: Sequence[Argument]) -> str:
    """Return the arguments as a table of names, defaults and descriptions."""
    listed.extend(arguments)
    rows = [(printable(f"{a.name}:={a.default}"), printable(a.help)) for a in arguments]
    width = min(max((len(left) for left, _ in rows), default=0), 34)
    return "\n".join(f"  {left:{width}}  {right}".rstrip() for left, right in rows)


# Arguments of several commands ------------------------------------------------------------------

OF_MODEL = "model."  # before the name of an argument of the model that the command has, too
PACKAGES = Argument(PACKAGE_PATH, "", "folders with ROS packages, joined by :, searched first")

_NAMESPACE = re.compile(r"/?|/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*/?")
_LEVELS = ("debug", "info", "warn", "error", "fatal")
_AS_IN_FILE = "default: params_file's"
_PACE = "not simulated: messages on joint_states; default: that of params_file or joints"
_OF_SIMULATION = ("params_file", "nav2_topics", "robots")  # besides parameters of controllers
_OF_JOINTS = ("joints", "joint_states")
_STEERING_PAGE = "steering_page"
_OF_ONE_ROBOT = ("x", "y", "yaw", "frame_prefix", "reload")


def take_package_path(given: Mapping[str, str]) -> dict[str, str]:
    """Add ``package_path:=`` to the package search path; return the model's arguments."""
    use_package_path(given.get(PACKAGE_PATH, ""))
    return model_values(given, {PACKAGE_PATH})


def model_values(given: Mapping[str, str], own_names: Collection[str]) -> dict[str, str]:
    """Return the xacro arguments of the model: ``model.NAME``, and NAME if the command has none."""
    return {
        name.removeprefix(OF_MODEL): value for name, value in given.items() if name not in own_names
    }


def model_arguments(
    declared: Iterable["XacroArgument"], own_names: Collection[str]
) -> list[Argument]:
    """Return the xacro arguments of the model as they are written on the command line."""
    return [
        Argument(f"{OF_MODEL}{name}" if name in own_names else name, default, description)
        for name, default, description in declared
    ]


def ros_settings() -> list[Argument]:
    """Return the arguments about names and discovery."""
    words = "words of letters, digits and _ that do not start with a digit, joined by /"
    name = ValueType(str, Rule(pattern=_NAMESPACE, write=f"a ROS name: {words}"))
    namespace = Argument("namespace", "", "the namespace of all nodes", name)
    return [namespace, *discovery_settings()]


def discovery_settings() -> list[Argument]:
    """Return the arguments about which nodes are discovered."""
    return [
        number("domain_id", "", "ROS_DOMAIN_ID; empty: the environment's", 0, MAX_DOMAIN, int),
        Argument(
            "discovery",
            LOCALHOST,
            "which nodes are discovered: localhost, subnet, or HOST:PORT of a discovery server; "
            "not given: the environment's",
            ValueType(str, Rule(pattern=ARGUMENT, write=WANTED)),
            examples=(LOCALHOST, "subnet"),
        ),
    ]


def description_arguments(model: str, joints: str, view: str) -> list[Argument]:
    """Return the arguments of a bringup; ``model``, ``joints`` and ``view`` are defaults."""
    namespace, *discovery = ros_settings()
    return [
        Argument("model", model, "the robot: a URDF or xacro file, also as package://pkg/path"),
        PACKAGES,
        Argument(
            "joints",
            joints,
            "a YAML file of joint_state_publisher's parameters, reloaded when edited; "
            "empty: joints swing",
        ),
        switch("joint_states", True, "run joint_state_publisher; false: the robot has its own"),
        parameter_of("rerun_viewer", ViewerParameters, "viewer"),
        parameter_of("rerun_viewer", ViewerParameters, "view", default=view),
        parameter_of("rerun_viewer", FrameSettings, "fixed_frame"),
        parameter_of("rerun_viewer", ViewerParameters, "save"),
        Argument("record", "", "record all topics to this new folder, a rosbag2 in MCAP"),
        switch("reload", True, "apply edits of the model while running"),
        namespace,
        Argument(
            "frame_prefix",
            "",
            "prefix of the frames; not given: the namespace, such as r1/; empty: none",
        ),
        *parameters_of(
            "robot_state_publisher", StateParameters, "publish_frequency", "ignore_timestamp"
        ),
        switch("use_sim_time", False, "take the time from /clock"),
        choice("log_level", "info", "the least severe log messages shown", _LEVELS),
        *discovery,
    ]


def simulation_arguments(control: str) -> list[Argument]:
    """Return the arguments of simulation; ``control`` is the default of ``params_file``."""
    from onebot_control.drive_kinds import ControlConfig  # slow to import

    of_controller = _arguments_of(DRIVE_CONTROLLER, ControlConfig)
    return [
        switch("sim", True, "simulate it; false: joint_state_publisher moves its joints"),
        Argument(
            "robots",
            "",
            "several robots in one world: how many, or a YAML file with their names and places",
        ),
        *_steering(),
        Argument("params_file", control, "parameters of the controller, a YAML file"),
        of_controller("left_wheel_names", "left_wheel"),
        of_controller("right_wheel_names", "right_wheel"),
        *_surroundings(of_controller),
        of_controller("ground_truth_tf"),
        switch("nav2_topics", False, "the topics that Nav2 expects, cmd_vel and odom"),
        *_pace(of_controller),
    ]


def standing_arguments() -> list[Argument]:
    """Return the arguments of simulation for a standing robot, such as an arm."""
    from onebot_control.simulation_parameters import SimulationConfig  # slow to import

    of_simulation = _arguments_of(MANAGER, SimulationConfig)
    return [
        switch("sim", False, "simulate it, with its joints commanded by trajectories"),
        *_steering(),
        Argument("params_file", "", "parameters of the controllers, a YAML file"),
        *_surroundings(of_simulation),
        *_pace(of_simulation),
    ]


def _steering() -> list[Argument]:
    return [
        switch("steer", False, "a page to steer it from, beside its view"),
        *parameters_of(_STEERING_PAGE, PageParameters, "host", "port", "token"),
    ]


def _arguments_of(node: str, kind: type) -> Callable[..., Argument]:
    """Return a function that makes arguments of a node's parameters with defaults in a file."""

    def argument(
        parameter: str, name: str = "", note: str = _AS_IN_FILE, **further: Any
    ) -> Argument:
        return parameter_of(node, kind, parameter, name, default="", note=note, **further)

    return argument


def _surroundings(argument: Callable[..., Argument]) -> list[Argument]:
    """Return the arguments about the robot's place, its surroundings and its sensors."""
    from onebot_description.description.loading import shipped_worlds  # slow to import

    return [
        *map(argument, ("x", "y", "yaw")),
        argument("world", examples=tuple(shipped_worlds())),
        argument("sensors"),
    ]


def _pace(argument: Callable[..., Argument]) -> list[Argument]:
    """Return the arguments about the speed of the simulation."""
    return [
        argument("update_rate", "rate", note=_PACE),
        argument("real_time_factor"),
        argument("paused"),
    ]


def checked_values(declared: list[Argument], given: Mapping[str, str]) -> dict[str, str]:
    """Return a checked value for each argument.

    As several robots may publish to one /tf, frames are prefixed with the namespace, as in
    diff_drive_controller, unless ``frame_prefix`` is given (even if empty).
    """
    values = complete(declared, given)
    if "frame_prefix" not in given:
        values["frame_prefix"] = namespace_prefix(values["namespace"])
    prefix = values["frame_prefix"]
    if values.get("sim") == "true" and prefix and not prefix.endswith("/"):
        raise UsageError(f"frame_prefix:={prefix} must end with /, as in frame_prefix:={prefix}/")
    _check_effect(declared, values, given)
    return values


def _check_effect(
    declared: Iterable[Argument], values: Mapping[str, str], given: Mapping[str, str]
) -> None:
    """Reject arguments of what is switched off, and those of a single robot for several."""
    for argument in declared:
        name, node = argument.name, argument.node
        if name not in given:
            continue
        written = f"{name}:={given[name]}"
        of_controller = node in (DRIVE_CONTROLLER, MANAGER) and name != "rate"
        if values.get("sim") == "false" and (of_controller or name in _OF_SIMULATION):
            if values[name] not in ("", "false"):
                raise UsageError(f"{written} is for the simulation: write sim:=true")
        elif values.get("sim") == "true" and name in _OF_JOINTS:
            text = "is without effect, since the simulation moves the joints: leave it out"
            raise UsageError(f"{written} {text}, or write sim:=false")
        elif values.get("steer") == "false" and node == _STEERING_PAGE:
            raise UsageError(f"{written} is the steering page's: add steer:=true")
        elif values.get("robots") and name in _OF_ONE_ROBOT and values[name] != "false":
            raise UsageError(f"{written} is for one robot, not for robots:={values['robots']}")
