"""robot_state_publisher under load, beside the least that any rclpy node needs.

The floor is a relay (relay.py) that parses nothing and sends constant bytes of the same size. Both
nodes are processes of their own, each in a ROS domain of its own, and are asked in turn with four
messages in flight (load.py).
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message

from onebot_description.ros.domains import used_domain
from onebot_description.ros.wire.messages import transforms_message
from tests.benchmarks.chains import Chain
from tests.benchmarks.load import Load, Window
from tests.benchmarks.measuring import in_turn, median, over
from tests.benchmarks.report import Report, Result
from tests.ros_support import NodeProcess

# Joints to the most CPU per message allowed, over the floor's.
_GOALS = {10: 1.25, 50: 1.3, 200: 1.4, 1000: 2.0}
_LATENCY_GOAL = 1.2


def run(quick: bool) -> Report:
    """Measure chains of 10 to 1000 joints; quickly, the shortest and the longest."""
    results = []
    for joints in (min(_GOALS), max(_GOALS)) if quick else _GOALS:
        ours, floor = _measure(joints, quick)
        what = f"{joints} joints:"
        cpu, latency = (
            ([window[field] for window in ours], [window[field] for window in floor])
            for field in (0, 1)
        )
        results += [
            Result(f"{what} CPU per message", median(cpu[0]), unit="us"),
            Result(f"{what} CPU per message over the floor", over(*cpu), _GOALS[joints]),
            Result(f"{what} p50 latency over the floor", over(*latency), _LATENCY_GOAL),
        ]
    return results


def _measure(joints: int, quick: bool) -> tuple[list[Window], list[Window]]:
    """Return the windows of robot_state_publisher, and those of the floor."""
    # Many rounds: by which processor wakes which, a window of the relay's as of ours has one of two
    # latencies, at 1000 joints 270 or 360 us, all through.
    rounds, seconds = (1, 0.05) if quick else (21, 0.5)
    chain = Chain(joints)
    parents, children = zip(*chain.frames, strict=True)
    zeros = chain.transforms(chain.positions(1))[0]
    constant = bytes(serialize_message(transforms_message(Time(sec=1), parents, children, zeros)))
    with (
        _subject("tests.benchmarks.relay", chain, constant, constant) as floor,
        _subject("onebot_description.robot_state_publisher", chain, chain.urdf().encode()) as ours,
    ):
        windows = in_turn(
            {"ours": lambda: ours.measure(seconds), "floor": lambda: floor.measure(seconds)}, rounds
        )
    return windows["ours"], windows["floor"]


@contextmanager
def _subject(
    module: str, chain: Chain, content: bytes, constant: bytes | None = None
) -> Iterator[Load]:
    """A node that reads a file with ``content``, and answers."""
    with TemporaryDirectory() as folder, used_domain() as domain:
        file = Path(folder) / "content.urdf"
        file.write_bytes(content)
        with NodeProcess(module, str(file)) as node, Load(domain, node, chain, constant) as load:
            load.wait()
            yield load
