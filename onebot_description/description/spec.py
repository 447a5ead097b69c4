"""What a checked robot description says, as plain values."""

from dataclasses import dataclass
from pathlib import Path

Triple = tuple[float, float, float]

JOINT_KINDS = ("fixed", "revolute", "continuous", "prismatic", "floating", "planar")


@dataclass(frozen=True)
class MimicSpec:
    """A joint that follows another: position = multiplier * position of ``joint`` + offset.

    Attributes:
        joint: the name of the joint followed, which may itself follow one.
        multiplier: without unit (or m/rad and rad/m between kinds).
        offset: rad, or m for a prismatic joint.
    """

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class JointSpec:
    """One joint, as REP-103 has it: SI units, radians.

    Attributes:
        name: the joint's name.
        kind: one of ``JOINT_KINDS``.
        parent: the link it hangs on.
        child: the link it moves.
        xyz: position of the joint frame in the parent link's frame, m.
        rpy: its orientation there: roll, pitch, yaw about the parent's fixed axes, rad.
        axis: unit vector in the joint frame; (1, 0, 0) if none is given or the kind has none.
        lower: least position, rad or m; None for kinds that have no limits.
        upper: greatest position, rad or m; None for kinds that have no limits.
        velocity: greatest speed, rad/s or m/s; None if not given.
        effort: greatest torque or force, Nm or N; None if not given.
        mimic: what it follows, or None.
    """

    name: str
    kind: str
    parent: str
    child: str
    xyz: Triple
    rpy: Triple
    axis: Triple
    lower: float | None
    upper: float | None
    velocity: float | None
    effort: float | None
    mimic: MimicSpec | None


@dataclass(frozen=True)
class Description:
    """A robot description that has passed every check.

    Attributes:
        urdf: the URDF text: xacro expanded, axes of unit length, indented, no comments.
        robot_name: the ``name`` of ``<robot>``.
        source: absolute path of the file loaded, or the name given to ``parse_description``.
        files: absolute paths of all files read, the loaded one first (for watching them).
        root_link: the one link that is no joint's child.
        links: link names in the order of the XML.
        joints: the joints in the order of the XML.
        warnings: what works but is probably not meant.
    """

    urdf: str
    robot_name: str
    source: str
    files: tuple[Path, ...]
    root_link: str
    links: tuple[str, ...]
    joints: tuple[JointSpec, ...]
    warnings: tuple[str, ...]
