"""Where a view comes from: a file, what its user edits in it, and what he switches meanwhile."""

import os
import tempfile
from pathlib import Path
from typing import Any

from onebot_bringup.viewer.view_config import ViewConfig, load_view, parse_view, view_text
from onebot_bringup.viewer.view_files import view_for
from onebot_bringup.viewer.view_settings import changed_settings, with_setting
from onebot_bringup.viewer.yaml_edit import set_value
from onebot_description.errors import OneBotError
from onebot_description.joints.watch import FileWatch

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
