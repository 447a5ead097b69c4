"""config/dimensions.yaml (m, kg, kg/m3; colors are sRGB, 0 to 1)."""

from pathlib import Path
from typing import Any

from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.parameters.files import Parameters, read_map, read_text
from onebot_description.parameters.values import Rule, ValueType

_COUNTS = ("wheel.spokes", "wheel.tread_blocks")
_NUMBER, _NUMBERS = ValueType(float), ValueType(float, many=True, length=3)
_COUNT = ValueType(int, Rule(at_least=1))


class Section:
    """A map of the file. Its keys are attributes: a number, a list of three, or a section."""

    def __init__(self, file: str, content: Parameters, prefix: str = "") -> None:
        self._file, self._content, self._prefix = file, content, prefix

    def __getattr__(self, key: str) -> Any:
        name = f"{self._prefix}{key}"
        values = self._content.values
        if name in values:
            number_type = _NUMBERS if isinstance(values[name], list) else _NUMBER
            try:
                return (_COUNT if name in _COUNTS else number_type).checked(values[name])
            except ValueError as error:
                raise OneBotError(f"{self._content.places[name]}: {name}: {error}") from None
        if any(entry.startswith(f"{name}.") for entry in values):
            return Section(self._file, self._content, f"{name}.")
        inside = (entry for entry in values if entry.startswith(self._prefix))
        known_keys = {entry.removeprefix(self._prefix).split(".")[0] for entry in inside}
        raise OneBotError(f"{self._file} has no {name}{did_you_mean(key, known_keys)}")


def read_dimensions(path: Path) -> Section:
    """Read the file of dimensions."""
    return Section(str(path), read_map(read_text(path), str(path)))
