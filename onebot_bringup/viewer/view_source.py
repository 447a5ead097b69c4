"""Where a view comes from: a file, what its user edits in it, and what is switched meanwhile."""

import io
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import YAMLError
from ruamel.yaml.representer import RoundTripRepresenter
from ruamel.yaml.scalarstring import SingleQuotedScalarString

from onebot_bringup.viewer.rviz_config import RVIZ_SUFFIX, load_rviz
from onebot_bringup.viewer.view_config import (
    ViewConfig,
    changed_settings,
    load_view,
    parse_view,
    view_for,
    view_text,
)
from onebot_description.errors import OneBotError
from onebot_description.file_watch import Changes, FileWatch
from onebot_description.parameters.files import read_text
from onebot_description.parameters.reader import ConfigError, replaced

NO_VIEW = "none"
_ANY_WIDTH = 2**30  # of a line, which is never wrapped


class ViewSource:
    """The view in force: the file's, with the settings that were changed since.

    Attributes:
        view: how to look at the robot.
        blueprint_file: the ``.rbl`` file whose layout replaces the view's; None for the view's.
    """

    def __init__(self, source: str, notice: Callable[[str], object] = print) -> None:
        """Read the view of ``source``.

        Args:
            source: a view file (.yaml), RViz's own (.rviz), a layout saved in the viewer (.rbl),
                "" for the view that belongs to the robot, or "none" for none.
            notice: called with what of an RViz file is not shown.

        Raises:
            OneBotError: there is no such file, or it is wrong.
        """
        self._of_robot = not source
        self._file: Path | None = None
        self._base = ViewConfig()
        self.view = self._base
        self.blueprint_file: Path | None = None
        path = Path(source).expanduser().absolute() if source not in ("", NO_VIEW) else None
        if path is not None and path.suffix == ".rbl":
            check_blueprint_file(path)
            self.blueprint_file = path
            self._of_robot = True  # what the blueprint arranges
        elif path is not None:
            self._file, self._base = path, load_any_view(path, notice)
            self.view = self._base
        self._watch = FileWatch(self._files)

    @property
    def _files(self) -> list[Path]:
        return [file for file in (self._file, self.blueprint_file) if file is not None]

    @property
    def file(self) -> Path | None:
        """The view file, if there is one."""
        return self._file

    def set_robot(self, name: str, *, in_world: bool = False) -> bool:
        """Use the view of the robot ``name``, unless a file was given; True if it is another one.

        Args:
            name: as the robot's URDF has it.
            in_world: something stands around the robot.

        Raises:
            OneBotError: it is wrong.
        """
        file = view_for(name, in_world=in_world) if self._of_robot else self._file
        if file == self._file:
            return False
        base = load_view(file) if file is not None else ViewConfig()
        self._file = file
        self._rebase(base)
        self._watch.watch(self._files)
        return True

    def poll(self) -> Changes:
        """Return which of its files the user has saved or removed since the last call."""
        return self._watch.poll()

    def reload(self, file: Path, saved: ViewConfig) -> bool:
        """Use what was read from the view file again; True if that changes the view.

        Of a setting that was changed here and in the file, the file's value counts: it is newer.

        Args:
            file: the view file at the time; nothing is changed if it is another one now.
            saved: the view in it.
        """
        before = self.view
        if file == self._file:
            self._rebase(saved)
        return self.view != before

    def _rebase(self, base: ViewConfig) -> None:
        """Replace what the file holds by ``base``, and keep what was changed here."""
        edited = changed_settings(self._base, base)
        view = base
        for name, value in changed_settings(self._base, self.view).items():
            if name not in edited:
                view = replaced(view, name, value)
        self._base, self.view = base, view

    def change(self, name: str, value: Any) -> None:
        """Change a setting until its file is read anew.

        Raises:
            ConfigError: it cannot have that value.
        """
        self.view = replaced(self.view, name, value)

    def save(self, to: Path | None = None) -> Path:
        """Write the view into its file, whose comments stay, or into another one.

        Returns:
            The file written.

        Raises:
            OneBotError: there is no file to write to, or it cannot be written.
        """
        target = to or self._file
        if target is None:
            raise OneBotError("this view has no file: name one with the parameter save_view_to")
        target = target.expanduser().absolute()
        if target.suffix not in (".yaml", ".yml"):
            raise OneBotError(f"view {target}: the name of a view file must end in .yaml")
        _write(target, self._text(target))
        if target == self._file:
            self._base = self.view
        return target

    def _text(self, target: Path) -> str:
        """The text of its file with the settings in force; a new text where there is no file."""
        try:
            text = read_text(self._file) if self._file is not None else ""
            text = edit_yaml(text, changed_settings(parse_view(text), self.view))
            if parse_view(text) == self.view:
                return text
        except (ValueError, ConfigError):
            pass  # its form is not one that single values can be changed in
        if target == self._file:
            raise OneBotError(
                f"view {target}: cannot be saved with its comments kept, because it has been "
                "changed meanwhile or uses YAML's anchors; name another file with the parameter "
                "save_view_to"
            )
        return view_text(self.view)


def load_any_view(path: Path, notice: Callable[[str], object]) -> ViewConfig:
    """Read a view file, ours or RViz's.

    Raises:
        OneBotError: there is no such file, or it is wrong.
    """
    return load_rviz(path, notice) if path.suffix == RVIZ_SUFFIX else load_view(path)


def check_blueprint_file(path: Path) -> None:
    """Refuse what is no layout saved in the viewer.

    Raises:
        OneBotError: with what is wrong.
    """
    if not path.is_file():
        raise OneBotError(f"view:={path}: there is no such file")
    with path.open("rb") as file:
        if file.read(3) != b"RRF":
            raise OneBotError(f"view:={path}: this is no layout saved in the viewer")


def edit_yaml(text: str, values: Mapping[str, Any]) -> str:
    """Return YAML ``text`` with other values, and its comments kept.

    Args:
        text: a mapping, or nothing.
        values: a scalar or a list of scalars by dotted name, such as ``camera.eye``; keys that are
            missing are added.

    Raises:
        ValueError: it is no such YAML, or a name leads into something other than a mapping.
    """
    editor = YAML()
    editor.Representer = _Representer
    editor.preserve_quotes = True
    editor.width = _ANY_WIDTH
    try:
        root = editor.load(text)
    except YAMLError as error:
        raise ValueError(str(error)) from error
    start = ""
    if root is None:  # ruamel drops the comments of nothing
        root = CommentedMap()
        start = text if not text or text.endswith("\n") else f"{text}\n"
    for name, value in values.items():
        _set(root, name.split("."), value)
    out = io.StringIO()
    if root:
        editor.dump(root, out)
    return start + out.getvalue()


def _set(root: Any, path: Sequence[str], value: Any) -> None:
    mapping = root
    for depth, key in enumerate(path):
        if not isinstance(mapping, CommentedMap):
            raise ValueError(f'"{".".join(path[:depth])}" is no mapping')
        if depth == len(path) - 1:
            _put(mapping, key, _node(value), at_end=mapping is root)
        elif mapping.get(key) is None:
            _put(mapping, key, CommentedMap(), at_end=mapping is root)
        mapping = mapping[key]


def _put(mapping: CommentedMap, key: str, value: Any, *, at_end: bool) -> None:
    """Set a key. A new one comes before the last: what follows that may be the next mapping's."""
    if key in mapping or at_end or not mapping:
        mapping[key] = value
    else:
        mapping.insert(len(mapping) - 1, key, value)


def _node(value: Any) -> Any:
    """Return ``value`` as ruamel.yaml is to write it."""
    if isinstance(value, list):
        items = CommentedSeq(map(_node, value))
        items.fa.set_flow_style()
        return items
    if isinstance(value, str) and _pyyaml(value)[0] in "'\"":
        return SingleQuotedScalarString(value)
    return value


class _Representer(RoundTripRepresenter):
    """Writes YAML 1.2 that PyYAML, which reads YAML 1.1, reads as the same values."""

    def represent_float(self, data: float) -> Any:
        """Write an exponent with a dot before it."""
        return self.represent_scalar("tag:yaml.org,2002:float", _pyyaml(data))


_Representer.add_representer(float, _Representer.represent_float)


def _pyyaml(value: Any) -> str:
    text: str = yaml.safe_dump(value, allow_unicode=True, width=_ANY_WIDTH)
    return text.removesuffix("\n").removesuffix("\n...")


def _write(path: Path, text: str) -> None:
    """Write a file whole or not at all; a link stays one."""
    path = path.resolve()
    try:
        mode = path.stat().st_mode & 0o777 if path.exists() else 0o644
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", dir=path.parent, prefix=f".{path.name}-", delete=False
        ) as new:
            new.write(text)
        os.chmod(new.name, mode)
        os.replace(new.name, path)
    except OSError as error:
        raise OneBotError(f"view {path}: cannot be written: {error.strerror}") from error
