"""``onebot tf ...``: shows the tree of frames, and transforms like tf2_echo."""

import math
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Iterable
from functools import cache
from typing import TYPE_CHECKING

from onebot_bringup.cli.options import Subcommand, flag, natural, option, positional, positive, warn
from onebot_bringup.cli.session import Session, in_session
from onebot_bringup.introspection.rates import Arrivals
from onebot_description.description.tree_text import aligned, branches, cell
from onebot_description.errors import OneBotError
from onebot_description.ros.names import node_name
from onebot_description.timing import NS_PER_S

if TYPE_CHECKING:
    from onebot_description.arrays import Floats
    from onebot_description.ros.wire.message_arrays import TfArrays

_WINDOW = 1000  # maximum number of samples of a rate
_PARTICIPANT = 12  # bytes of a GID that identify the participant


@in_session
def tree(session: Session, args: Namespace) -> None:
    """Print the tree of frames, with rate and age."""
    transforms = _Transforms(session)
    transforms.await_first()
    session.spin_for(args.wait_time)
    print("\n".join(_drawn(transforms)))
    for warning in _faults(transforms):
        transforms.warn(warning)


def received_frames(session: Session) -> list[str]:
    """Return the names of the frames that are received within a second after the first."""
    transforms = _Transforms(session)
    transforms.await_first()
    session.spin_for(1.0)
    return sorted(transforms.frames.names)


def _drawn(transforms: "_Transforms") -> list[str]:
    frames, now = transforms.frames, transforms.session.node.get_clock().now().nanoseconds
    roots = frames.roots
    edges = frames.edges
    below: dict[str, list[str]] = {name: [] for name in frames.names}
    for child in sorted(edges.keys() - roots):
        below[edges[child].parent].append(child)
    rows = [("frame", "rate", "age")]
    for branch, name in branches(roots, lambda frame: below[frame]):
        columns = _rate_and_age(transforms, name, now) if name in edges else ("", "")
        rows.append((branch + cell(name), *columns))
    return aligned(rows)


def _rate_and_age(transforms: "_Transforms", name: str, now: int) -> tuple[str, str]:
    span = transforms.frames.span(name)
    if span is None:
        return "static", ""
    rate = transforms.arrivals[name].rate()
    return f"{rate:.1f} Hz" if rate else "once", f"{(now - span[1]) / NS_PER_S:.3f} s"


def _faults(transforms: "_Transforms") -> list[str]:
    """Return sentences about problems of the tree as a whole."""
    roots, children = transforms.frames.roots, transforms.frames.edges
    faults = []
    if len(roots) > 1:
        faults.append(f"{len(roots)} unconnected trees, of {', '.join(map(cell, roots))}")
    for root in roots:
        if root in children:
            faults.append(f"{cell(root)} is in a loop: it is below itself")
    for child, parents in sorted(transforms.parents.items()):
        if len(parents) > 1:
            names = " and ".join(map(cell, sorted(parents)))
            faults.append(
                f"{cell(child)} has {len(parents)} parents, {names}: it jumps between them"
            )
    for name, count in _publishing_nodes(transforms.session).items():
        if count > 1:
            faults.append(
                f"/tf is published by {count} nodes named {name}: their frames jump between two "
                "robots. Stop one, or start one with namespace:=NAME"
            )
    return faults


def _publishing_nodes(session: Session) -> Counter[str]:
    """Return the number of nodes of each name that publish /tf.

    Nodes with the same name are distinguished by their processes' participants, the first bytes of
    a publisher's GID.
    """
    ends = session.node.get_publishers_info_by_topic("/tf")
    nodes = {(node_name(end), bytes(end.endpoint_gid[:_PARTICIPANT])) for end in ends}
    return Counter(name for name, _ in nodes if name)


@in_session
def echo(session: Session, args: Namespace) -> None:
    """Print the pose of one frame in another.

    Raises:
        OneBotError: there is no transform within ``--timeout``.
    """
    transforms = _Transforms(session)
    _await_transform(transforms, args, args.timeout)
    due, period = time.monotonic(), 1.0 / args.rate
    while True:
        pose = transforms.frames.lookup(args.a, args.b)
        print(_shown(pose.stamp_ns, pose.matrix, args.precision))
        if args.once:
            return
        due = max(due + period, time.monotonic())
        session.spin_until(due)
        _await_transform(transforms, args, None)


def _await_transform(transforms: "_Transforms", args: Namespace, timeout: float | None) -> None:
    """Wait for the transform between the frames; after a second print why there is none."""

    def problem() -> str:
        try:
            transforms.frames.lookup(args.a, args.b)
        except OneBotError as error:
            return str(error)
        return ""

    if not transforms.session.await_or_report(
        lambda: not problem(),
        lambda: f"Waiting for transform {args.a} ->  {args.b}: {problem()}",
        timeout,
    ):
        raise OneBotError(f"no transform {args.a} -> {args.b}: {problem()}")


def _shown(stamp_ns: int, pose: "Floats", precision: int) -> str:
    """Return the text that tf2_echo prints for a pose."""
    from onebot_description.geometry.poses import rpy_of_rows
    from onebot_description.geometry.quaternions import from_matrix

    def vector(numbers: Iterable[float]) -> str:
        return f"[{', '.join(f'{number:.{precision}f}' for number in numbers)}]"

    angles = rpy_of_rows(pose[:3, :3].tolist())
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    return "\n".join(
        (
            f"At time {seconds}.{nanoseconds:09d}",
            f"- Translation: {vector(pose[:3, 3])}",
            f"- Rotation: in Quaternion (xyzw) {vector(from_matrix(pose[:3, :3]))}",
            f"- Rotation: in RPY (radian) {vector(angles)}",
            f"- Rotation: in RPY (degree) {vector(map(math.degrees, angles))}",
            "- Matrix:",
            *(f"  {' '.join(f'{x:{precision + 3}.{precision}f}' for x in row)}" for row in pose),
        )
    )


class _Transforms:
    """Receives /tf and /tf_static in a session."""

    def __init__(self, session: Session) -> None:
        from onebot_description.ros.frame_tree import FrameTree
        from onebot_description.ros.tf_subscription import subscribe_to_tf

        self.frames = FrameTree()
        self.arrivals: dict[str, Arrivals] = {}  # keys: child frames
        self.parents: dict[str, set[str]] = {}  # parent frames, by child frame
        self.session = session
        self.warn = cache(warn)  # each text once
        subscribe_to_tf(session.node, self._receive, self.warn)

    def _receive(self, message: "TfArrays", static: bool) -> None:
        for warning in self.frames.add(message, static=static):
            self.warn(warning)
        now = time.monotonic()
        for parent, child in zip(message.parents, message.children, strict=True):
            self.parents.setdefault(child, set()).add(parent)
            self.arrivals.setdefault(child, Arrivals(_WINDOW)).add(now)

    def await_first(self) -> None:
        """Wait for the first transform."""
        if not self.session.look_for(lambda: self.frames.names, "transforms"):
            raise OneBotError("no transform was received on /tf and /tf_static")


COMMANDS = {
    "tree": Subcommand(
        "show the tree of frames, with rates and ages",
        tree,
        option("-w --wait-time", "S", "how long transforms are collected (2 s)", positive, 2.0),
    ),
    "echo": Subcommand(
        "print the pose of one frame in another, like tf2_echo",
        echo,
        positional("A", "a frame, such as odom"),
        positional("B", "the frame whose pose in A is shown"),
        option("-r --rate", "HZ", "prints per second (1)", positive, 1.0),
        flag("-1 -o --once", "print it once and exit"),
        option("-t --timeout", "S", "give up after S s", positive),
        option("-p --precision", "N", "digits after the point (3)", natural, 3),
        endless=lambda args: not args.once,
    ),
}
