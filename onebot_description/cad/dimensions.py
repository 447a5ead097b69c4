"""config/dimensions.yaml as typed values, each key checked."""

import dataclasses
import math
import types
import typing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import yaml

from onebot_description.errors import OneBotError, did_you_mean

T = TypeVar("T")
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Wheel:
    """A driven wheel (m, N m, rad/s)."""

    radius: float
    separation: float
    width: float
    rim_radius: float
    hub_radius: float
    spokes: int
    tread_blocks: int
    tread_depth: float
    contact_width: float
    effort: float
    velocity: float


@dataclass(frozen=True)
class CasterWheel:
    """The caster's wheel (m)."""

    radius: float
    width: float
    rim_radius: float


@dataclass(frozen=True)
class Caster:
    """The caster and its place (m)."""

    x: float
    mount_height: float
    trail: float
    plate_radius: float
    leg_thickness: float
    gap: float
    crown_gap: float
    boss_radius: float
    axle_end: float
    wheel: CasterWheel

    @property
    def axle_drop(self) -> float:
        """How far the wheel's axle lies below the mount, when the wheel stands on the ground."""
        return self.mount_height - self.wheel.radius


@dataclass(frozen=True)
class Sensor:
    """The dome on the deck (m)."""

    x: float
    radius: float
    height: float


@dataclass(frozen=True)
class Motor:
    """A motor inside the base (m)."""

    radius: float
    length: float


@dataclass(frozen=True)
class Ballast:
    """The block whose mass and place give the base its centre of mass (m)."""

    length: float
    width: float
    height: float


@dataclass(frozen=True)
class Base:
    """The base (m), in the frame of base_link."""

    front: float
    rear: float
    width: float
    bottom: float
    deck: float
    tail_start: float
    tail_bottom: float
    wall: float
    bumper: float
    seam_height: float
    seam_slope: float
    seam_width: float
    axle_radius: float
    axle_length: float
    sensor: Sensor
    motor: Motor
    ballast: Ballast


@dataclass(frozen=True)
class Dimensions:
    """The whole file (m, kg, kg/m3; colours are sRGB, 0 to 1)."""

    wheel: Wheel
    caster: Caster
    base: Base
    base_mass: float
    base_center_of_mass: Vector
    densities: dict[str, float]
    colors: dict[str, Vector]


def read_dimensions(path: Path) -> Dimensions:
    """Read the file of dimensions.

    Raises:
        OneBotError: it cannot be read, or a key is missing, unknown or of the wrong kind.
    """
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise OneBotError(f"{path}: {error.strerror}") from error
    except yaml.YAMLError as error:
        raise OneBotError(f"{path}: {error}") from error
    try:
        return _structure(Dimensions, data, "")
    except ValueError as error:
        raise OneBotError(f"{path}: {error}") from error


def _structure(kind: type[T], data: object, where: str) -> T:
    """Make the dataclass ``kind`` of a mapping with exactly its fields as keys."""
    name = where or "the file"
    if not isinstance(data, dict):
        raise ValueError(f"{name} must be a mapping, not {data!r}")
    known = typing.get_type_hints(kind)
    fields = [field.name for field in dataclasses.fields(typing.cast(Any, kind))]
    for key in data:
        if key not in fields:
            raise ValueError(f'{name} has an unknown key "{key}"{did_you_mean(str(key), fields)}')
    if missing := [field for field in fields if field not in data]:
        raise ValueError(f"{name} lacks {', '.join(missing)}")
    path = f"{where}." if where else ""
    return kind(**{key: _value(known[key], data[key], path + key) for key in fields})


def _value(kind: Any, data: object, where: str) -> Any:
    if dataclasses.is_dataclass(kind):
        return _structure(typing.cast(type, kind), data, where)
    if isinstance(kind, types.GenericAlias) and kind.__origin__ is dict:
        if not isinstance(data, dict):
            raise ValueError(f"{where} must be a mapping, not {data!r}")
        inner = typing.get_args(kind)[1]
        return {str(key): _value(inner, value, f"{where}.{key}") for key, value in data.items()}
    if isinstance(kind, types.GenericAlias):
        if not isinstance(data, list) or len(data) != 3:
            raise ValueError(f"{where} must be three numbers, not {data!r}")
        return tuple(_value(float, value, where) for value in data)
    right = isinstance(data, int if kind is int else (int, float)) and not isinstance(data, bool)
    if not right or not math.isfinite(typing.cast(float, data)):
        raise ValueError(f"{where} must be a {'whole ' if kind is int else ''}number, not {data!r}")
    return kind(data)
