"""Contact sensors, such as bumpers."""

from dataclasses import dataclass

from onebot_description.description.sensors.block import Block
from onebot_description.description.sensors.kind import Kind
from onebot_description.elements.sensor import SensorModel


@dataclass(frozen=True)
class ContactSensor(SensorModel):
    """A sensor of everything that touches its link, with all of the link's shapes."""

    @property
    def summary(self) -> str:
        return "contacts of its link"


class ContactKind(Kind[ContactSensor]):
    """How a contact sensor is described."""

    types = ("contact",)
    message_types = {"contacts": "ros_gz_interfaces/msg/Contacts"}
    elements = {"sensor": "contact", "contact": "collision topic"}

    @staticmethod
    def read(block: Block) -> ContactSensor:
        return ContactSensor()
