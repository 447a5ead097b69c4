"""config/dimensions.yaml as typed values, each key checked."""

from dataclasses import dataclass
from pathlib import Path

from onebot_description.geometry.poses import Triple
from onebot_description.ros.parameters.files import read_map, read_text
from onebot_description.ros.parameters.reader import read


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
    """The caster and its mounting position (m)."""

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
        """The distance of the wheel's axle below the mount, with the wheel on the ground."""
        return self.mount_height - self.wheel.radius


@dataclass(frozen=True)
class SensorDome:
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
    """The block that gives the base its mass and centre of mass (m)."""

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
    sensor: SensorDome
    motor: Motor
    ballast: Ballast


@dataclass(frozen=True)
class Dimensions:
    """The whole file (m, kg, kg/m3; colours are sRGB, 0 to 1)."""

    wheel: Wheel
    caster: Caster
    base: Base
    base_mass: float
    base_center_of_mass: Triple
    densities: dict[str, float]
    colors: dict[str, Triple]


def read_dimensions(path: Path) -> Dimensions:
    """Read the file of dimensions."""
    content = read_map(read_text(path), str(path))
    return read(Dimensions, content.values, content.places)
