"""Parameter files that count while the node runs, not only when it starts."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from onebot_description.joints.config import DEFAULTS, GROUPS
from onebot_description.joints.parameter_files import read_files, silence
from onebot_description.joints.parameter_yaml import Parameters

# They say where to look, and setting them while the node runs is to look elsewhere.
_SOURCES = ("config_file", "robot_description")


class LiveParameters:
    """What the parameter files say to one node, now and when they are next saved.

    Saving makes every parameter as the files say: what they do not name goes back to its default,
    also if it was set while the node ran. Only what the command line has set stays.
    """

    def __init__(self, files: Sequence[Path], node: str) -> None:
        """Read ``files`` for ``node``, its full name; later files come first.

        Raises:
            ConfigError: a file cannot be read, or is not ROS 2 parameter YAML.
        """
        self._files = tuple(files)
        self._extra: tuple[Path, ...] = ()
        self._node = node
        self._pinned: dict[str, Any] = {}
        self.file = self.read()

    @property
    def files(self) -> tuple[Path, ...]:
        """All the files."""
        return (*self._files, *self._extra)

    @property
    def names(self) -> str:
        """The files in words."""
        return ", ".join(str(file) for file in self.files)

    @property
    def remark(self) -> str | None:
        """A warning if the files say nothing to this node."""
        return silence(self.file, self.files, self._node)

    def add(self, config_file: str) -> None:
        """Take the file of the parameter ``config_file`` as the last of the files.

        Raises:
            ConfigError: as above; then nothing has changed.
        """
        before = self._extra
        self._extra = (Path(config_file),) if config_file else ()
        try:
            self.file = self.read()
        except Exception:
            self._extra = before
            raise

    def pin(self, names: Iterable[str], values: Mapping[str, Any]) -> None:
        """Remember the parameters of these ``names`` that the command line decided."""
        written = self.file.values
        self._pinned = {
            name: values[name]
            for name in names
            if name in values and name not in _SOURCES and values[name] != written.get(name)
        }

    def read(self) -> Parameters:
        """Read the files as they are now.

        Raises:
            ConfigError: as above.
        """
        return read_files(self.files, self._node)

    def changes(self, file: Parameters, current: Mapping[str, Any]) -> dict[str, Any]:
        """Return what to set, None to unset, for ``current`` to be as ``file`` says."""
        wanted = {**DEFAULTS, **file.values, **self._pinned}
        changes = {
            name: value
            for name, value in wanted.items()
            if name not in current or not _same(current[name], value)
        }
        gone = [name for name in current if name.split(".")[0] in GROUPS and name not in wanted]
        return {**changes, **dict.fromkeys(gone)}

    def overruled(self, file: Parameters) -> list[str]:
        """Names that were edited in ``file`` in vain, as the command line decides them."""
        edited = (n for n in self._pinned if file.values.get(n) != self.file.values.get(n))
        return list(edited)

    def places(self, values: Mapping[str, Any]) -> dict[str, str]:
        """Return where those of ``values`` were written that the files decided."""
        written = self.file.values
        places = self.file.places
        return {key: at for key, at in places.items() if _same(values.get(key), written[key])}


def _same(one: Any, other: Any) -> bool:
    return type(one) is type(other) and bool(one == other)
