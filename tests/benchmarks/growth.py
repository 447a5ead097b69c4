"""How cost grows with the number of joints, from 10 to 10000.

robot_state_publisher under load in a closed loop (see state_publisher.py) beside the relay of the
same bytes, and its parts without DDS: bytes to bytes (StateConverter), the arrays only
(RobotModel.transforms), the links' poses, and reading the description. All are processor or wall
time for each joint, so that a horizontal line is growth in proportion. How cost grows with the
number of robots is the simulation's benchmark.
"""

import time
from collections.abc import Callable, Mapping

import numpy as np

from onebot_description.description import parse_description
from onebot_description.model import RobotModel
from onebot_description.wire.state_converter import StateConverter
from tests.benchmarks import state_publisher
from tests.benchmarks.answers import AnswerChecker
from tests.benchmarks.chains import Chain, pose_error
from tests.benchmarks.load_generator import joint_state
from tests.benchmarks.measuring import WrongAnswer, median, seconds_per_call
from tests.benchmarks.registry import Options
from tests.benchmarks.report import Plot, Report, Value
from tests.benchmarks.state_publisher import CLOSED_LOOP, FLOOR, OURS, Effort

_COUNTS = (10, 30, 100, 300, 1000, 3000, 10000)
_QUICK_COUNTS = (10, 100)
# scipy's own answer to each link's pose in turn takes long, and rounds off on the way.
_MOST_CHECKED = 1000
_TOLERANCE = 1e-9
_READING, _CONVERTING = "read the description", "bytes to bytes (StateConverter)"
_TRANSFORMS, _LINK_POSES = "RobotModel.transforms", "RobotModel.link_poses"
_STAMP_NS = 1_700_000_000_123_456_789


def run(options: Options) -> Report:
    """Measure chains of 10 to 10000 joints."""
    rows: list[dict[str, Value]] = []
    effort = Effort(1, 30, 0.5) if options.quick else Effort(3, 20_000, 1.5)
    for joints in _QUICK_COUNTS if options.quick else _COUNTS:
        nodes = state_publisher.measure(
            joints, state_publisher.commands(OURS, FLOOR), effort, options, (CLOSED_LOOP,)
        )[CLOSED_LOOP]
        options.say(f"growth: {joints} joints, without DDS")
        costs = {name: node.median("cpu_us") for name, node in nodes.items()}
        costs |= _parts(joints, 0.002 if options.quick else 0.2)
        rows.append(_row(joints, costs))
    notes = [
        "Microseconds of processor time a message for the nodes, of wall time a call for the rest. "
        "All answers were checked. At 10000 joints one message is in flight, not four: more do not "
        "fit in Fast DDS's shared memory.",
    ]
    return Report("growth", rows, (), notes, _plots(rows))


def _parts(joints: int, least: float) -> dict[str, float]:
    """Time what needs no ROS around it, in microseconds a call."""
    chain = Chain(joints)
    positions = chain.positions(1)[0]
    urdf = chain.urdf()
    began = time.perf_counter()
    description = parse_description(urdf)
    model = RobotModel.from_description(description)
    reading = time.perf_counter() - began
    converter = StateConverter(model)
    message = joint_state(chain, positions, _STAMP_NS)
    _check(chain, model, converter, message)

    def timed(function: Callable[[], object]) -> float:
        return 1e6 * median([seconds_per_call(function, least) for _ in range(3)])

    return {
        _CONVERTING: timed(lambda: converter.convert_bytes(message, time.time_ns())),
        _TRANSFORMS: timed(lambda: model.transforms(positions)),
        _LINK_POSES: timed(lambda: model.link_poses(positions)),
        _READING: 1e6 * reading,
    }


def _check(chain: Chain, model: RobotModel, converter: StateConverter, message: bytes) -> None:
    """Compare what is timed with the chain's own answers.

    Raises:
        WrongAnswer: they differ.
    """
    joints = len(chain.joints)
    positions = chain.positions(1)
    answer = converter.convert_bytes(message, time.time_ns())
    if answer is None:
        raise WrongAnswer(f"{joints} joints: StateConverter gives no answer")
    AnswerChecker(chain, positions).check(answer, 0, _STAMP_NS)
    found = np.concatenate(model.transforms(positions), axis=-1)
    error = pose_error(found, chain.transforms(positions))
    if joints <= _MOST_CHECKED:
        poses = model.link_poses(positions)[0, :, :3]
        expected = chain.link_matrices(positions)[0, :, :3, 3]
        far = max(1.0, float(np.abs(expected).max()))
        error = max(error, float(np.abs(poses - expected).max()) / far)
    if not error <= _TOLERANCE:
        raise WrongAnswer(f"{joints} joints: a transform of RobotModel is off by {error:.3g}")


def _row(joints: int, costs: Mapping[str, float]) -> dict[str, Value]:
    row: dict[str, Value] = {"Joints": joints}
    row |= {f"{name}: us": cost for name, cost in costs.items()}
    row["over floor"] = costs[OURS] / costs[FLOOR]
    row["us/joint"] = costs[OURS] / joints
    return row


def _plots(rows: list[dict[str, Value]]) -> list[Plot]:
    def curves(*names: str) -> dict[str, list[tuple[float, float]]]:
        return {
            name: [(_number(row, "Joints"), _number(row, f"{name}: us")) for row in rows]
            for name in names
        }

    return [
        Plot(
            "robot_state_publisher by joints",
            "joints",
            "CPU us a message",
            curves(OURS, FLOOR, _CONVERTING),
            _bend(rows),
        ),
        Plot(
            "RobotModel by joints",
            "joints",
            "us a call",
            curves(_READING, _LINK_POSES, _TRANSFORMS),
        ),
    ]


def _bend(rows: list[dict[str, Value]]) -> str:
    """Say how fast the node's cost and the relay's grow from size to size, and why it bends."""
    joints = [_number(row, "Joints") for row in rows]
    exponents = {
        name: np.diff(np.log([_number(row, f"{name}: us") for row in rows]))
        / np.diff(np.log(joints))
        for name in (OURS, FLOOR)
    }
    steps = "; ".join(
        f"{joints[i]:g} to {joints[i + 1]:g}: {ours:.2f} ({floor:.2f})"
        for i, (ours, floor) in enumerate(zip(*exponents.values(), strict=True))
    )
    return (
        "exponent of the node's growth, and in brackets of the relay's (0: constant, 1: in "
        f"proportion): {steps}. Few joints cost what any message costs: receiving, publishing, "
        "waking up. It bends where the joints' own bytes come to cost more than that; where the "
        "relay bends as well, it is the middleware that moves them."
    )


def _number(row: Mapping[str, Value], name: str) -> float:
    value = row[name]
    assert isinstance(value, (int, float))
    return float(value)
