"""Measures with contact sensors: the contacts of their links."""

from collections.abc import Set
from typing import Any, NamedTuple

import numpy as np

from onebot_control.sensing.instrument import Instrument, SensedWorld
from onebot_description.arrays import Floats
from onebot_description.description.sensors.contact import ContactSensor


class LinkContact(NamedTuple):
    """The contact of a link with one other link, in the frame of the sensor's messages."""

    link: str
    other: str  # the other body and its link, such as "world::wall"; "ground" has no links
    points: Floats  # (N, 3), m
    normals: Floats  # (N, 3), unit vectors towards the link
    forces: Floats  # (N,), normal forces on the link, N


class ContactInstrument(Instrument[ContactSensor]):
    """Measures the contacts of a contact sensor in the last control cycle."""

    waiting = 50
    needs_contacts = True

    def measure(self, world: SensedWorld, wanted: Set[str]) -> dict[str, Any]:
        link, placed = self.sensor.link, world.placed
        frame = placed.link(self.row, self.sensor.frame) or placed.link(self.row, link)
        assert frame is not None
        contacts = [item for item in world.frame.contacts[self.row] if item.link == link]
        points = np.array([item.point for item in contacts]).reshape(-1, 3) - frame.position
        normals = np.array([item.normal for item in contacts]).reshape(-1, 3)
        forces = np.array([item.force for item in contacts])
        names = ["::".join(filter(None, (item.other, item.other_link))) for item in contacts]
        touching = {name: [item == name for item in names] for name in names}
        return {
            "contacts": [
                LinkContact(
                    link,
                    name,
                    points[rows] @ frame.rotation,
                    normals[rows] @ frame.rotation,
                    forces[rows],
                )
                for name, rows in touching.items()
            ]
        }
