"""A simulated sensor as plain values, and the base class of sensor models."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field

from onebot_description.geometry.poses import Origin


class SensorModel(ABC):
    """The properties of a sensor; each kind of sensor has its own model."""

    @property
    @abstractmethod
    def summary(self) -> str:
        """What it measures, as ``onebot check`` prints it."""

    @property
    def rays(self) -> tuple[int, int]:
        """The number of a lidar's rows, and of rays in each row; 1 and 1 for other sensors."""
        return 1, 1


@dataclass(frozen=True)
class Sensor:
    """One simulated <sensor>, or the part of it that one of its plugins publishes."""

    name: str
    link: str
    origin: Origin  # relative to the link
    rate: float  # measurements per simulated second, Hz; 0: one in each control cycle
    topics: Mapping[str, str]  # relative or absolute names, by output
    frame: str  # frame_id of the messages, usually a link
    model: SensorModel
    where: str = field(default="", compare=False)
