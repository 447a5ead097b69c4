"""Reads a description's settings of the physics, and warns about those that are not simulated.

These are the children of ``<gazebo>``, as sdformat converts them, except sensors and plugins, and
the limits of URDF 1.2.
"""

from collections.abc import Collection, Mapping
from typing import NamedTuple

from onebot_description.description.sensors.unread import asks_for_something
from onebot_description.elements.reading import Element, Findings, number_fault, value_text
from onebot_description.elements.urdf import MAX_FRICTION, Joint
from onebot_description.errors import listing, nearest

_FALSE, _TRUE = ("false", "no", "0"), ("true", "yes", "1")
_GRAVITY, _NO_GRAVITY, _FRICTION = "gravity", "turnGravityOff", ("mu", "mu1", "mu2")
_FRICTION_USED = (
    "is the friction of arms, grippers and worlds, in all directions and at most 1; a wheeled base "
    'and its wheels ignore it: write <contact><lateral_friction value="..."/> in the link'
)
# Both ask to keep the frame of each link, which is always done here.
_FULFILLED = ("preserveFixedJoint", "disableFixedJointLumping")
_REASONS = {
    "contacts are rigid here": "kp kd minDepth maxVel maxContacts",
    "links of one robot do not collide here": "selfCollide self_collide",
    "friction is the same in all directions here": "fdir1",
    "colors are those of <visual>": "material visual",
    "is not simulated": "dampingFactor velocity_decay laserRetro static kinematic enable_wind axis "
    "allow_auto_disable stopCfm stopErp fudgeFactor provideFeedback implicitSpringDamper pose "
    "light cfmDamping springReference springStiffness initial_joint_position collision physics "
    "slip1 slip2",
}
_REASON_OF = {tag: reason for reason, tags in _REASONS.items() for tag in tags.split()}
_LIMITS = ("acceleration", "deceleration", "jerk")


class LinkPhysics(NamedTuple):
    """The physics of a link in ``<gazebo reference="LINK">``."""

    gravity: bool = True  # whether gravity acts on it
    friction: float | None = None  # coefficient of friction


def read_physics(
    findings: Findings,
    links: Collection[str],
    joints: Mapping[str, Joint],
    used: frozenset[Element],
) -> dict[str, LinkPhysics]:
    """Return the physics of links by name; warn, once per reason, about what is not simulated.

    Args:
        findings: findings of the document; faults are added.
        links: names of the links.
        joints: joints by name.
        used: elements that have been read elsewhere.
    """
    unused, physics, names = _Unused(findings, used), dict[str, LinkPhysics](), {*links, *joints}
    rolls = any(joint.kind == "continuous" for joint in joints.values())
    for block in findings.document.root.iterfind("gazebo"):
        name = block.get("reference")
        elements = [element for element in block if not _is_of_others(element)]
        if elements and name is not None and name not in names:
            hint = findings.hint(name, names, "links and joints")
            findings.warning(block, f'there is no link or joint "{name}", so it is ignored{hint}')
            continue
        for element in elements:
            if (
                name is None
                or name not in links
                or element.tag not in (_GRAVITY, _NO_GRAVITY, *_FRICTION)
            ):
                if asks_for_something(element):
                    unused.add(_reason(element.tag), f"<{element.tag}>", element, name)
                continue
            physics[name] = _read(findings, element, physics.get(name, LinkPhysics()))
            if element.tag in _FRICTION and (rolls or not _is_usual(element, physics[name])):
                unused.add(_FRICTION_USED, f"<{element.tag}>", element, name)
    for joint in findings.document.root.iterfind("joint"):
        for limit in joint.iterfind("limit"):
            for attribute in filter(limit.keys().__contains__, _LIMITS):
                text = "motions ignore this limit"
                unused.add(text, attribute, limit, joint.get("name"))
    unused.report()
    return physics


def _is_of_others(element: Element) -> bool:
    """Return whether an element has its effect elsewhere, or a sensor's reader warns about it."""
    return element.tag in _FULFILLED or any(
        part.tag in ("sensor", "plugin") for part in element.iter()
    )


class _Unused:
    """Collects elements without effect, to report each reason once, except ``used`` elements."""

    def __init__(self, findings: Findings, used: frozenset[Element]) -> None:
        self._findings, self._used = findings, used
        self._found: dict[str, tuple[Element, dict[str, None], dict[str, None]]] = {}

    def add(self, reason: str, what: str, element: Element, owner: str | None) -> None:
        parts = [part for part in element.iter() if not len(part)]
        if not self._used.isdisjoint(parts):
            for part in parts:
                if part not in self._used:
                    self._add(_reason(part.tag), f"<{part.tag}>", part, owner)
        else:
            self._add(reason, what, element, owner)

    def _add(self, reason: str, what: str, element: Element, owner: str | None) -> None:
        _, names, owners = self._found.setdefault(reason, (element, {}, {}))
        names[what], owners[owner or "the robot"] = None, None

    def report(self) -> None:
        for reason, (element, names, owners) in self._found.items():
            text = f"{', '.join(names)} of {listing(owners, most=5)}: {reason}"
            self._findings.warning(element, text)


def _reason(tag: str) -> str:
    if tag in _REASON_OF:
        return _REASON_OF[tag]
    guess = nearest(tag, (*_REASON_OF, _GRAVITY, _NO_GRAVITY, *_FRICTION))
    return "is not known" + (f'; did you mean "{guess}"?' if guess else "")


def _read(findings: Findings, element: Element, physics: LinkPhysics) -> LinkPhysics:
    """Return a link's ``physics``, updated by an element for gravity or friction."""
    text, name = value_text(element), element.tag
    if name in _FRICTION:
        if (fault := number_fault(text)) or float(text) < 0.0:
            findings.problem(element, fault or f'"{text}" is negative; it must not be')
            return physics
        friction = physics.friction if name == "mu2" else None
        return physics._replace(friction=float(text) if friction is None else friction)
    if text.lower() not in (*_FALSE, *_TRUE):
        findings.problem(element, f'"{text}" is neither true nor false')
        return physics
    return physics._replace(gravity=(text.lower() in _TRUE) == (name == _GRAVITY))


def _is_usual(element: Element, physics: LinkPhysics) -> bool:
    """Return whether an element for friction can be simulated as it is."""
    friction = physics.friction
    return friction is None or float(value_text(element)) == friction <= MAX_FRICTION
