"""Reads YAML files of parameters, ROS 2 parameter files and others, with the line of each value.

rcl reads a file only once, when the process starts, and its errors name neither the parameter nor
how to fix it. Here a file can be read again while the node runs. The dataclass of the parameters
defines which values are valid; see ``reader``.
"""

import functools
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import yaml

from onebot_description.errors import listing, shortened
from onebot_description.parameters import bounded_yaml
from onebot_description.parameters.reader import (
    ConfigError,
    Problem,
    defaults,
    is_parameter,
    unknown_parameters,
)
from onebot_description.parameters.values import INT64

_MARK = "ros__parameters"
_BOOLS = {
    **dict.fromkeys("y Y yes Yes YES true True TRUE on On ON".split(), True),
    **dict.fromkeys("n N no No NO false False FALSE off Off OFF".split(), False),
}
_INTEGER = re.compile(r"[-+]?(0[xX][0-9a-fA-F]+|[0-9]+)")
_DOUBLE = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_VARIABLE = re.compile(r"\$\(var \w+\)")  # a variable of a launch file
_NOT_FINITE = re.compile(r"([-+]?)\.?(inf|infinity|nan)", re.IGNORECASE)

Unknown = Callable[[Iterable[str]], list[Problem]]
"""A function that returns a problem for each name that a node does not declare."""


@dataclass
class Parameters:
    """The parameters for one node in files."""

    values: dict[str, Any] = field(default_factory=dict)  # keys: dotted names
    places: dict[str, str] = field(default_factory=dict)  # file and line of each, joints.yaml:7
    shared: set[str] = field(default_factory=set)  # names in a section for several nodes
    sections: list[str] = field(default_factory=list)  # node names in the files
    warnings: list[str] = field(default_factory=list)  # a line for each ignored entry

    def update(self, later: "Parameters") -> None:
        """Add the parameters of a later file, which override these."""
        self.values.update(later.values)
        self.places.update(later.places)
        self.shared = (self.shared - later.values.keys()) | later.shared
        self.sections += later.sections
        self.warnings += [text for text in later.warnings if text not in self.warnings]

    def drop_shared(self, unknown: Unknown) -> None:
        """Drop unknown parameters in sections for several nodes, which are for other nodes."""
        for problem in unknown(sorted(self.shared)):
            self.drop(problem.key)

    def drop(self, name: str) -> None:
        """Drop a parameter, if it is there."""
        self.values.pop(name, None)
        self.places.pop(name, None)
        self.shared.discard(name)


def read_parameters(text: str, name: str, node: str) -> Parameters:
    """Read the parameters for one node from the text of a ROS 2 parameter file.

    Args:
        text: the YAML.
        name: name of the file, for messages.
        node: full name, such as ``/joint_state_publisher``.

    Raises:
        ConfigError: the YAML is broken, or not a ROS 2 parameter file.
    """
    merged = Parameters()
    for section, parameters in read_sections(text, name).items():
        merged.sections.append(section)
        if section_matches(section, node):
            merged.update(parameters)
    return merged


@functools.lru_cache(maxsize=8)
def read_sections(text: str, name: str) -> dict[str, Parameters]:
    """Return a file's parameters by section, which is a pattern of full names of nodes.

    It is read once for several nodes.
    """
    file = _YamlFile(text, name)
    sections: dict[str, Parameters] = {}

    def gather(node: yaml.Node, path: str) -> None:
        for key, value in file.pairs(node, repeatable=True):
            if key.value == _MARK:
                parameters = _section(file, value)
                if path.rpartition("/")[2] in ("*", "**"):
                    parameters.shared = set(parameters.values)
                sections.setdefault(path or "/", Parameters()).update(parameters)
            elif isinstance(value, yaml.MappingNode):
                gather(value, f"{path}/{key.value.strip('/')}")
            else:
                file.fail(key, f'"{key.value}" must hold a map with "{_MARK}:" in it')

    if file.root is not None:
        gather(file.root, "")
    for parameters in sections.values():
        parameters.warnings += file.warnings
    return sections


def section_matches(section: str, node: str) -> bool:
    """Return whether a section is for ``node``; ``*`` matches one name, ``**`` any number."""
    pattern = "/" + section.strip("/")
    expression = re.escape(pattern).replace(r"/\*\*", r"(/\w+)*").replace(r"/\*", r"/\w+")
    return re.fullmatch(expression, node) is not None


class _YamlFile:
    """The tree of a YAML file; errors name file and line.

    Attributes:
        root: the root node; None if the file is empty.
        warnings: a line for each entry that has no effect, added as it is read.
    """

    def __init__(self, text: str, name: str) -> None:
        self._name, self._variables = name, set[str]()
        self.warnings: list[str] = []
        try:
            self.root = bounded_yaml.compose(text)
        except yaml.YAMLError as error:
            if not isinstance(error, yaml.MarkedYAMLError):
                raise self._error(None, f"invalid YAML: {error}") from None
            mark = error.problem_mark or error.context_mark
            # libyaml adds a line end to a last line without one.
            line = min(mark.line, text.count("\n")) if mark else None
            reason = " ".join(part for part in (error.context, error.problem) if part)
            raise self._error(line, f"invalid YAML: {reason}") from None

    def pairs(
        self, node: yaml.Node, *, repeatable: bool = False
    ) -> list[tuple[yaml.ScalarNode, yaml.Node]]:
        """Return keys and values of a map, whose keys must be plain words.

        They must also be unique, unless they are ``repeatable``, as section names are in rcl.
        """
        if not isinstance(node, yaml.MappingNode):
            what = f'"{shortened(node.value)}"' if isinstance(node, yaml.ScalarNode) else "a list"
            self.fail(node, f"{what} is in place of a map")
        lines: dict[str, int] = {}
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                self.fail(key, "a name must be a plain word")
            if key.value in lines and (key.value == _MARK or not repeatable):
                self.fail(key, f'"{key.value}" occurs twice, first on line {lines[key.value]}')
            lines[key.value] = key.start_mark.line + 1
        return list(node.value)

    def entries(
        self, node: yaml.Node, prefix: str = "", *, merge: bool = False
    ) -> Iterator[tuple[str, str, yaml.Node]]:
        """Yield dotted name, place and value of each entry of a map and of the maps in it.

        With ``merge``, the maps in a list, and maps with the same name, are merged, as in rcl.
        """
        for key, value in self.pairs(node, repeatable=merge):
            name = prefix + (self.text(key) if merge else key.value)
            maps = value.value if merge and isinstance(value, yaml.SequenceNode) else [value]
            if maps and all(isinstance(item, yaml.MappingNode) and item.value for item in maps):
                for item in maps:
                    yield from self.entries(item, f"{name}.", merge=merge)
            else:
                yield name, f"{self._name}:{key.start_mark.line + 1}", value

    def text(self, node: yaml.ScalarNode) -> str:
        """Return the text of a node without variables of launch files; warn once about each."""
        for variable in {*_VARIABLE.findall(node.value)} - self._variables:
            self._variables.add(variable)
            line = node.start_mark.line + 1
            text = f"only ros2 launch can replace {variable}; it is left out"
            self.warnings.append(f"{self._name}:{line}: {text}")
        return _VARIABLE.sub("", node.value)

    def fail(self, node: yaml.Node, text: str) -> NoReturn:
        """Raise the error about what is wrong at ``node``."""
        raise self._error(node.start_mark.line, text)

    def _error(self, line: int | None, text: str) -> ConfigError:
        place = self._name if line is None else f"{self._name}:{line + 1}"
        return ConfigError([Problem("", f"{place}: {text}")])


def _section(file: _YamlFile, node: yaml.Node) -> Parameters:
    parameters = Parameters()
    for name, place, value in file.entries(node, merge=True):
        # rcl cannot infer the type of an empty list, and treats it as not given.
        if value.value or isinstance(value, yaml.ScalarNode):
            if earlier := parameters.places.get(name):
                text = f"{place}: {name}: is also at {earlier}; this later one counts"
                file.warnings.append(text)
            parameters.values[name] = _value(file, name, value)
            parameters.places[name] = place
    return parameters


def _value(file: _YamlFile, name: str, node: yaml.Node) -> Any:
    if isinstance(node, yaml.ScalarNode):
        return _scalar(file, name, node)
    values = [_scalar(file, name, item) for item in node.value]
    if len({type(value) for value in values}) > 1:
        remedy = "write all its numbers with a decimal point, as in 1.0, or quote all its strings"
        file.fail(node, f"{name}: a list holds values of one kind; {remedy}")
    return values


def _scalar(file: _YamlFile, name: str, node: Any) -> bool | int | float | str:
    if not isinstance(node, yaml.ScalarNode):
        file.fail(node, f"{name}: a list holds plain values only")
    text = file.text(node)
    if node.style:  # quoted, or a block of text
        return text
    if not node.value:
        file.fail(node, f"{name}: has no value")
    return plain_value(text)


def plain_value(text: str) -> bool | int | float | str:
    """Return the value of an unquoted word in rcl: a bool, an integer, a double or a string."""
    if text in _BOOLS:
        return _BOOLS[text]
    if _INTEGER.fullmatch(text):
        for base in (0, 8):  # 010 is octal, 09 is a double
            with suppress(ValueError):
                if (value := int(text, base)) in INT64:
                    return value
    if word := _NOT_FINITE.fullmatch(text):
        return float(word[1] + word[2])
    return float(text) if _DOUBLE.fullmatch(text) else text


# Other YAML files: maps without nodes ------------------------------------------------------------


def read_map(text: str, name: str) -> Parameters:
    """Return the values by dotted names of a YAML file that is a map, such as a saved view.

    Unlike a parameter file, it may contain null and lists of anything; an empty map is a value.
    """
    content, loader = Parameters(), yaml.SafeLoader("")
    file = _YamlFile(text, name)
    for entry, place, node in file.entries(file.root) if file.root is not None else ():
        try:
            content.values[entry] = loader.construct_object(node, deep=True)
        except Exception as error:  # any type, if a value does not match its tag
            file.fail(node, f"invalid YAML: {' '.join(str(error).split())}")
        content.places[entry] = place
    return content


# The parameter files of one node, read as one --------------------------------------------------


def read_files(files: Iterable[Path], node: str, kind: type) -> Parameters:
    """Read the parameters for ``node`` in ``files``; later files override.

    Unknown parameters in a section shared by several nodes are assumed to be for another node.
    Raises ConfigError if a file cannot be read, or is not a ROS 2 parameter file.
    """
    merged = Parameters()
    for file in files:
        merged.update(read_parameters(read_text(file), str(file), node))
    merged.drop_shared(lambda names: unknown_parameters(kind, names))
    return merged


def no_section(parameters: Parameters, files: Iterable[Path], node: str) -> str | None:
    """Return a warning if the files have sections, but none for ``node``."""
    sections = parameters.sections
    if not sections or any(section_matches(section, node) for section in sections):
        return None
    names = ", ".join(map(str, files))
    return f"{names} has no section for {node}, only for {listing(sections)}"


def check_sections(file: Path, nodes: Sequence[str]) -> None:
    """Check the sections of a file that a bringup gives to some nodes.

    Args:
        file: the file; each node checks its own section itself.
        nodes: the full names of the nodes.

    Raises:
        ConfigError: sections match none of the nodes, and would have no effect.
    """
    sections = read_sections(read_text(file), str(file))
    idle = [name for name in sections if not any(section_matches(name, node) for node in nodes)]
    if idle:
        text = '{}: section "{}" is for none of the nodes; {}'
        texts = [text.format(file, section, _meant(section, nodes)) for section in idle]
        raise ConfigError([Problem("", text) for text in texts])


def undeclared_warnings(file: Path, unknown: Iterable[Unknown]) -> list[str]:
    """Return a warning for each name in a section for several nodes that no node declares.

    Args:
        file: the file; each node checks its own section itself.
        unknown: a function for each node that reports the names that it does not declare.
    """
    warnings = []
    for section, parameters in read_sections(read_text(file), str(file)).items():
        names: set[str] = parameters.shared
        for report in unknown:
            names = {problem.key for problem in report(names)}
        warnings += [
            f'{parameters.places[name]}: {name} in section "{section}": no node of this bringup '
            "that is given the file declares it"
            for name in parameters.values
            if name in names
        ]
    return warnings


def _meant(section: str, nodes: Sequence[str]) -> str:
    """Return what to write: sections for nodes of that name, or else for any node."""
    name = f"/{section.rpartition('/')[2]}"
    namesakes = [node for node in nodes if node.endswith(name)]
    return f"write {f'/**{name}' if len(namesakes) > 1 else listing(namesakes or nodes)}"


def read_text(file: Path) -> str:
    """Return a file's text; raise ConfigError if it cannot be read."""
    try:
        return bounded_yaml.read_text(file)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigError([Problem("", f"{file}: cannot be read: {reason}")]) from None


# Parameter files that are followed while the node runs ------------------------------------------


class LiveParameters:
    """The parameters for one node in files, now and after they are saved again.

    Saving sets every parameter as in the files; parameters that they do not contain return to their
    defaults, even if they were set while the node ran. Only parameters from the command line stay.
    """

    def __init__(self, files: Sequence[Path], node: str, kind: type) -> None:
        """Read the files; later ones override earlier ones. Raises as ``read_files``."""
        self.files = tuple(files)
        self._node, self._kind = node, kind
        self._pinned: dict[str, Any] = {}
        self.file = self.read()

    @property
    def warning(self) -> str | None:
        """Ignored entries, and whether the files have sections, but none for this node."""
        missing = no_section(self.file, self.files, self._node)
        return "\n".join(filter(None, [*self.file.warnings, missing])) or None

    def pin(self, names: Iterable[str], values: Mapping[str, Any]) -> None:
        """Remember the parameters of these ``names``, which the command line sets."""
        self._pinned = {name: values[name] for name in names if name in values}

    def read(self) -> Parameters:
        """Read the files as they are now, in any thread; raises as ``read_files``."""
        return read_files(self.files, self._node, self._kind)

    def changes(self, file: Parameters, current: Mapping[str, Any]) -> dict[str, Any]:
        """Return the changes (None: unset) that bring ``current`` in line with ``file``."""
        names = [name for name in current if is_parameter(self._kind, name)]
        values = {**dict.fromkeys(names), **defaults(self._kind), **file.values, **self._pinned}
        if "robot_description" not in file.values:  # it comes from elsewhere
            values.pop("robot_description", None)
        return {n: value for n, value in values.items() if not _same(current.get(n), value)}

    def places(self, values: Mapping[str, Any]) -> dict[str, str]:
        """Return file and line of each of the ``values`` that came from the files."""
        written, places = self.file.values, self.file.places
        return {key: at for key, at in places.items() if _same(values.get(key), written[key])}


def _same(one: Any, other: Any) -> bool:
    # A file may have an integer for a double.
    return isinstance(one, bool) == isinstance(other, bool) and bool(one == other)
