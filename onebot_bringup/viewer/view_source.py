"""Where a view comes from: a file, edits of it, and settings changed in the running viewer."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from onebot_bringup.viewer.rviz_config import RVIZ_SUFFIX, load_rviz
from onebot_bringup.viewer.view_config import (
    ViewConfig,
    changed_settings,
    load_view,
    view_for,
    view_text,
)
from onebot_bringup.viewer.viewer_parameters import view_file
from onebot_description.atomic_write import write_whole
from onebot_description.errors import OneBotError
from onebot_description.file_watch import FileWatch
from onebot_description.parameters.reader import replaced


class ViewSource:
    """The current view: the file's, with the settings that were changed since.

    Attributes:
        view: the current view.
        file: the view file; None if there is none.
    """

    def __init__(self, source: str, notice: Callable[[str], object] = print) -> None:
        """Read the view of ``source``.

        Args:
            source: a view file (.yaml), RViz's own (.rviz), "" for the view that belongs to the
                robot, or "none" for none.
            notice: called with a sentence about the parts of an RViz file that are not shown.
        """
        self._notice = notice
        self.file = view_file(source)
        self._of_robot = not source
        self._base = self.view = self._loaded()
        self._watch = FileWatch(self._files)

    @property
    def _files(self) -> list[Path]:
        return [] if self.file is None else [self.file]

    def _loaded(self) -> ViewConfig:
        if self.file is None:
            return ViewConfig()
        if self.file.suffix == RVIZ_SUFFIX:
            return load_rviz(self.file, self._notice)
        return load_view(self.file)

    def set_robot(self, name: str, *, in_world: bool = False) -> bool:
        """Use the view that belongs to a robot, unless a file was given.

        Args:
            name: the name in the robot's URDF.
            in_world: whether anything stands around the robot.

        Returns:
            Whether the view file is a different one now.

        Raises:
            OneBotError: the file is invalid; the view stays until the file is fixed.
        """
        old_file = self.file
        if self._of_robot:
            self.file = view_for(name, in_world=in_world)
        if self.file == old_file:
            return False
        self._watch.watch(self._files)
        self.reload()
        return True

    def poll(self) -> list[Path]:
        """Return the view file if the user has saved or removed it since the last call."""
        return self._watch.poll()

    def reload(self) -> bool:
        """Read the view file again; return whether that changes the view.

        If a setting was changed both here and in the file, the file's value wins: it is newer.

        Raises:
            OneBotError: the file is invalid; the view stays.
        """
        old_view, base = self.view, self._loaded()
        edited = changed_settings(self._base, base)
        view = base
        for name, value in changed_settings(self._base, old_view).items():
            if name not in edited:
                view = replaced(view, name, value)
        self._base, self.view = base, view
        return view != old_view

    def change(self, name: str, value: Any) -> None:
        """Override a setting until it is changed in the file.

        Args:
            name: its dotted name, such as "axes.visible".
            value: its new value.

        Raises:
            ConfigError: it cannot have this value.
        """
        self.view = replaced(self.view, name, value)

    def save(self, to: Path | None = None) -> Path:
        """Save the view, without default values.

        Args:
            to: the file to write; None for the view's own.

        Returns:
            The file.

        Raises:
            OneBotError: there is no such file to write, or it cannot be written.
        """
        target = to or self.file
        if target is None:
            raise OneBotError("this view has no file: name one with the parameter save_view_to")
        target = target.expanduser().absolute()
        if target.suffix not in (".yaml", ".yml"):
            raise OneBotError(f"view {target}: the name of a view file must end in .yaml")
        try:
            write_whole(target, view_text(self.view).encode())
        except OSError as error:
            raise OneBotError(f"view {target}: cannot be written: {error.strerror}") from error
        if target == self.file:
            self._base = self.view
        return target
