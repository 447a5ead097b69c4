"""config/dimensions.yaml (m, kg, kg/m3; colours are sRGB, 0 to 1)."""

import math
from pathlib import Path
from typing import Any

from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.ros.parameters.files import Parameters, read_map, read_text


class Section:
    """A map of the file; its keys are attributes: numbers, lists of three numbers, or sections."""

    def __init__(self, file: str, content: Parameters, prefix: str = "") -> None:
        self._file, self._content, self._prefix = file, content, prefix

    def __getattr__(self, key: str) -> Any:
        name = f"{self._prefix}{key}"
        values = self._content.values
        if name in values:
            value = values[name]
            for number in value if isinstance(value, list) and len(value) == 3 else [value]:
                if not isinstance(number, (int, float)) or not math.isfinite(number):
                    place = self._content.places[name]
                    raise OneBotError(
                        f"{place}: {name}: {value!r} is neither a finite number nor three"
                    )
            return value
        if any(entry.startswith(f"{name}.") for entry in values):
            return Section(self._file, self._content, f"{name}.")
        inside = (entry for entry in values if entry.startswith(self._prefix))
        known_keys = {entry.removeprefix(self._prefix).split(".")[0] for entry in inside}
        raise OneBotError(f"{self._file} has no {name}{did_you_mean(key, known_keys)}")


def read_dimensions(path: Path) -> Section:
    """Read the file of dimensions."""
    return Section(str(path), read_map(read_text(path), str(path)))
