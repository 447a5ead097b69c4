"""Where a view comes from: a file, what its user edits in it, and what he switches meanwhile."""

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from onebot_bringup.viewer.settings import with_setting
from onebot_bringup.viewer.view_config import (
    ViewConfig,
    changed_settings,
    load_view,
    parse_view,
    view_for,
    view_text,
)
from onebot_description.errors import OneBotError
from onebot_description.file_watch import FileWatch

# Changing single values in YAML text, whose comments and form stay as the user wrote them.


def set_value(text: str, path: Sequence[str], value: Any) -> str:
    """Return YAML ``text`` with another value under the keys ``path``, which are added if missing.

    Args:
        text: a mapping, or nothing.
        path: such as ("camera", "eye").
        value: a scalar, or a list or mapping of such; None for null.

    Raises:
        ValueError: a key on the way holds something other than a mapping.
    """
    node = yaml.compose(text, yaml.SafeLoader)
    if node is None:
        start = text if not text or text.endswith("\n") else text + "\n"
        return f"{start}{_entry(path, value)}\n"
    for depth, key in enumerate(path):
        if not isinstance(node, yaml.MappingNode):
            if node.tag != "tag:yaml.org,2002:null":
                raise ValueError(f'"{".".join(path[:depth])}" is no mapping')
            return _put(text, node, _flow(_nested(path[depth:], value)))
        child = _child(node, key)
        if child is None:
            return _added(text, node, path[depth:], value)
        node = child
    return _put(text, node, _flow(value))


def _child(node: yaml.MappingNode, key: str) -> yaml.Node | None:
    # The last one of a key written twice is the one that counts.
    found = [child for name, child in node.value if name.value == key]
    return found[-1] if found else None


def _put(text: str, node: yaml.Node, new: str) -> str:
    """Write ``new`` in the place of ``node``."""
    start, end = node.start_mark.index, _end(node)
    if start == end and start and not text[start - 1].isspace():
        new = f" {new}"  # a key that nothing follows
    return text[:start] + new + text[end:]


def _end(node: yaml.Node) -> int:
    """Where ``node`` ends; that of a block would include the comments after it."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(last[1] if isinstance(last, tuple) else last)
    return int(node.end_mark.index)


def _added(text: str, node: yaml.MappingNode, path: Sequence[str], value: Any) -> str:
    """Add a key to ``node``, as its last."""
    entry = _entry(path, value)
    if node.flow_style:
        end = node.end_mark.index - 1  # before the brace
        if not node.value:
            return text[:end] + entry + text[end:]
        at = _end(node.value[-1][1])
        return f"{text[:at]}, {entry}{text[at:]}"
    indent = " " * node.value[0][0].start_mark.column
    line_end = text.find("\n", _end(node))
    at = len(text) if line_end < 0 else line_end
    return f"{text[:at]}\n{indent}{entry}{text[at:]}"


def _entry(path: Sequence[str], value: Any) -> str:
    key = _flow(path[0])
    return f"{key}: {_flow(_nested(path[1:], value))}"


def _nested(path: Sequence[str], value: Any) -> Any:
    for key in reversed(path):
        value = {key: value}
    return value


def _flow(value: Any) -> str:
    """Return ``value`` as YAML on one line."""
    text = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=float("inf"))
    return text.removesuffix("\n").removesuffix("\n...")


NO_VIEW = "none"


class ViewSource:
    """The view of now: the file's, with the settings that were changed since.

    Attributes:
        view: how to look at the robot.
        layout: the ``.rbl`` file whose layout takes the place of the view's; None for the view's.
    """

    def __init__(self, asked: str) -> None:
        """Read the view that the user asks for.

        Args:
            asked: a view file (.yaml), a layout saved in the viewer (.rbl), "" for the view that
                belongs to the robot, or "none" for none.

        Raises:
            OneBotError: there is no such file, or it is wrong.
        """
        self._of_robot = not asked
        self._file: Path | None = None
        self._base = ViewConfig()
        self.view = self._base
        self.layout: Path | None = None
        path = Path(asked).expanduser().absolute() if asked not in ("", NO_VIEW) else None
        if path is not None and path.suffix == ".rbl":
            check_layout(path)
            self.layout = path
            self._of_robot = True  # what the layout arranges
        elif path is not None:
            self._file, self._base = path, load_view(path)
            self.view = self._base
        self._watch = FileWatch(self._files)

    @property
    def _files(self) -> list[Path]:
        return [file for file in (self._file, self.layout) if file is not None]

    @property
    def file(self) -> Path | None:
        """The view file, if there is one."""
        return self._file

    def set_robot(self, name: str) -> bool:
        """Take the view of the robot ``name``, if that is asked for; True if it is another one.

        Raises:
            OneBotError: it is wrong.
        """
        file = view_for(name) if self._of_robot else self._file
        if file == self._file:
            return False
        base = load_view(file) if file is not None else ViewConfig()
        self._file = file
        self._take(base)
        self._watch.watch(self._files)
        return True

    def saved(self) -> list[Path]:
        """Return which of its files the user has saved since the last call."""
        return self._watch.saved()

    def reload(self) -> bool:
        """Read the view file again; True if that changes the view.

        Of a setting that was changed here and in the file, the file's value counts: it is newer.

        Raises:
            OneBotError: it is wrong; the view stays as it was.
        """
        if self._file is None:
            return False
        before = self.view
        self._take(load_view(self._file))
        return self.view != before

    def _take(self, base: ViewConfig) -> None:
        """Take ``base`` in the place of what the file said, and keep what was changed here."""
        said = changed_settings(self._base, base)
        view = base
        for name, value in changed_settings(self._base, self.view).items():
            if name not in said:
                view = with_setting(view, name, value)
        self._base, self.view = base, view

    def change(self, name: str, value: Any) -> None:
        """Change a setting until its file is read anew.

        Raises:
            ValueError: it cannot have that value.
        """
        self.view = with_setting(self.view, name, value)

    def save(self, to: Path | None = None) -> Path:
        """Write the view of now into its file, whose comments stay, or into another one.

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
        """The text of its file with the settings of now; a new text where there is no file."""
        try:
            text = self._file.read_text(encoding="utf-8") if self._file is not None else ""
            for name, value in changed_settings(parse_view(text), self.view).items():
                text = set_value(text, name.split("."), value)
            if parse_view(text) == self.view:
                return text
        except (OSError, ValueError):
            pass  # its form is not one that single values can be changed in
        if target == self._file:
            raise OneBotError(
                f"view {target}: cannot be saved with its comments kept, because it has been "
                "changed meanwhile or uses YAML's anchors; name another file with the parameter "
                "save_view_to"
            )
        return view_text(self.view)


def check_layout(path: Path) -> None:
    """Refuse what is no layout saved in the viewer.

    Raises:
        OneBotError: with what is wrong.
    """
    if not path.is_file():
        raise OneBotError(f"view:={path}: there is no such file")
    with path.open("rb") as file:
        if file.read(3) != b"RRF":
            raise OneBotError(f"view:={path}: this is no layout saved in the viewer")


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
