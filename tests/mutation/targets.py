"""What the mutation run mutates, the tests that must notice, and the mutants that no test can."""

import ast
import functools
from pathlib import Path
from typing import NamedTuple

CHECKOUT = Path(__file__).parents[2]


def _tests(package: str, *names: str) -> tuple[str, ...]:
    return tuple(f"tests/{package}/test_{name}.py" for name in names)


def _control(*names: str) -> tuple[str, ...]:
    return _tests("onebot_control", *names)


def _description(*names: str) -> tuple[str, ...]:
    return _tests("onebot_description", *names)


_SIMULATION = ("simulation_loading", "simulation_state", "simulation_motion")
_CHECKS = ("description_checks", "description_faults", "description_loading")
_SOURCE = ("joints_source", "joints_mimic")
_READER = ("parameters_reader", "parameters_values")

# Each module of a pure core with the test files that test it, the quickest first. Few tests
# in them make a node, and none a process of one.
TESTS: dict[str, tuple[str, ...]] = {
    "onebot_control/speed_limiter.py": _control("speed_limiter"),
    "onebot_control/odometry.py": _control("odometry"),
    "onebot_control/diff_drive.py": _control("diff_drive"),
    "onebot_control/driven_robot.py": _control("driven_robot", "fleet", "joint_state_broadcaster"),
    "onebot_control/fleet.py": _control("fleet"),
    "onebot_control/control_loop.py": _control("control_loop"),
    "onebot_control/wheels/finding.py": _control("wheels_finding", "wheels_geometry"),
    "onebot_control/wheels/geometry.py": _control("wheels_geometry"),
    "onebot_control/poses.py": _control("poses", "simulation_values"),
    "onebot_control/parameters.py": _control("control_config", "control_files"),
    "onebot_control/simulation/bodies.py": _control("simulation_bodies", *_SIMULATION),
    "onebot_control/simulation/rest_pose.py": _control(
        "simulation_settling", "scene", *_SIMULATION
    ),
    "onebot_control/simulation/scene_bodies.py": _control("scene"),
    "onebot_control/simulation/physics_settings.py": _control("simulation_values", "world"),
    "onebot_description/joints/config.py": _description("joints_config", "joints_source"),
    "onebot_description/joints/motions.py": _description(
        "joints_tracks", "joints_violations", *_SOURCE
    ),
    "onebot_description/joints/motion_limits.py": _description("joints_limits"),
    "onebot_description/joints/mimic.py": _description(*_SOURCE),
    "onebot_description/joints/source.py": _description(*_SOURCE),
    "onebot_description/description/checks.py": _description(*_CHECKS),
    "onebot_description/description/reading.py": _description(*_CHECKS),
    "onebot_description/description/expressions.py": _description("expressions"),
    "onebot_description/description/expansion.py": _description("expressions", *_CHECKS),
    "onebot_description/description/xacro.py": _description("xacro_arguments", *_CHECKS),
    "onebot_description/model/quaternions.py": _description("robot_model"),
    "onebot_description/model/robot_model.py": _description("robot_model"),
    "onebot_description/parameters/reader.py": _description(*_READER),
    "onebot_description/parameters/values.py": _description(*_READER),
    "onebot_bringup/launch/arguments.py": _tests(
        "onebot_bringup", "launcher_arguments", "bringup_nodes"
    ),
}


class Equivalent(NamedTuple):
    """A mutant that behaves as the code does, by the line that its printed diff adds or removes."""

    module: str
    definition: str  # "Class.method" or "function", "" at the module's level
    line: str  # as mutated, without indentation; as it was when the mutation removes it
    reason: str


EQUIVALENT = (
    Equivalent(
        "onebot_control/control_loop.py",
        "",
        "_PATIENCE = 11.0  # s for the loop to answer",
        "a deadline that nothing comes near",
    ),
    Equivalent(
        "onebot_control/control_loop.py",
        "SystemStamps.__init__",
        "self._last_due, self._last = 0, -(2*63)",
        "every stamp is after 1970",
    ),
    Equivalent(
        "onebot_control/driven_robot.py",
        "DrivenRobot.accept",
        "def accept(self, linear: float, angular: float, age: float = -1.0) -> str | None:",
        "an age below 0 counts as 0",
    ),
    Equivalent(
        "onebot_control/odometry.py",
        "Odometry.__init__",
        "self._since = -1.0",
        "the wheels' first positions only begin: the time before them counts for nothing",
    ),
    Equivalent(
        "onebot_control/simulation/rest_pose.py",
        "_come_to_rest",
        "needed, still = math.ceil(_RESTING_TIME * settings.rate), -1",
        "one step more of a robot at rest",
    ),
    Equivalent(
        "onebot_control/simulation/rest_pose.py",
        "_come_to_rest",
        "still = -1",
        "one step more of a robot at rest",
    ),
    Equivalent(
        "onebot_control/simulation/rest_pose.py",
        "_come_to_rest",
        "if still == needed:",
        "it counts in steps of one, and from 0 when it was reached",
    ),
    Equivalent(
        "onebot_control/simulation/rest_pose.py",
        "settle",
        "near = engine.getClosestPoints(robot.body, robot.ground, 999.0, physicsClientId=client)",
        "no robot begins so far above the ground",
    ),
    Equivalent(
        "onebot_control/simulation/rest_pose.py",
        "settle",
        "robot.place(rest_pose.at(0.0, 1.0, 0.0), [0.0] * len(robot.joints))",
        "every robot is then placed where it starts",
    ),
    Equivalent(
        "onebot_control/wheels/finding.py",
        "link_places",
        "for link, pose in zip(model.links, model.link_poses({}), strict=False):",
        "there are as many poses as links",
    ),
    Equivalent(
        "onebot_description/description/checks.py",
        "check_tree",
        'if len(roots) > 1 and len(ends) >= len(findings.document.root.findall("joint")):',
        "there are no more ends than joints",
    ),
    Equivalent(
        "onebot_description/joints/config.py",
        "MotionParameters.motion",
        'if self.type <= "constant":',
        "no kind of motion comes before constant",
    ),
    Equivalent(
        "onebot_description/joints/config.py",
        "MotionParameters.motion",
        'if self.type >= "sine":',
        "no kind of motion comes after sine",
    ),
    Equivalent(
        "onebot_description/joints/config.py",
        "MotionParameters.motion",
        'if self.type >= "pose":',
        "only poses and keyframes are left",
    ),
    Equivalent(
        "onebot_description/joints/config.py",
        "MotionParameters.notes",
        'if self.type >= "sine" and missing:',
        "no kind of motion comes after sine",
    ),
    Equivalent(
        "onebot_description/joints/motions.py",
        "_keyframes",
        "if motion.loop and abs(gap) > _WHOLE_TURN and times[-1] != 0.0:",
        "the times begin at 0 or later",
    ),
    Equivalent(
        "onebot_description/joints/motions.py",
        "_keyframes",
        "factor = 1.0 if motion.blend <= LINEAR else MINIMUM_JERK_PEAK",
        "no blend comes before linear",
    ),
    Equivalent(
        "onebot_description/joints/source.py",
        "JointStateSource._toward",
        "near = np.abs(way) < reach * (1.0 + _ROUNDING)",
        "the position is the same either way but for rounding",
    ),
    Equivalent(
        "onebot_description/model/quaternions.py",
        "to_matrix",
        "rotation = rotation / np.where(length > 0.0, length, 2.0)",
        "zeros, divided by whatever",
    ),
    Equivalent(
        "onebot_description/model/robot_model.py",
        "",
        "@functools.cache",
        "the library is loaded again, and is the same",
    ),
    Equivalent(
        "onebot_description/parameters/reader.py",
        "",
        "@functools.cache",
        "the same schema is made again",
    ),
    Equivalent(
        "onebot_description/parameters/values.py",
        "",
        "LARGEST = 1e+60",
        "the same number: one more or less is not to be seen in it",
    ),
)


def missing() -> list[str]:
    """Return what the tables name and the checkout does not have: they follow every move."""
    named = {*TESTS, *(file for files in TESTS.values() for file in files)}
    named.update(each.module for each in EQUIVALENT)
    lost = {path for path in named if not (CHECKOUT / path).is_file()}
    for each in EQUIVALENT:
        if each.module not in lost and each.definition not in _definitions(each.module):
            lost.add(f"{each.module}: {each.definition}")
    return sorted(lost)


@functools.cache
def _definitions(module: str) -> set[str]:
    """Return the names of a module's functions and classes, such as "Class.method", and ""."""
    found = {""}
    nodes: list[tuple[str, ast.AST]] = [("", ast.parse((CHECKOUT / module).read_text("utf-8")))]
    while nodes:
        prefix, node = nodes.pop()
        for child in ast.iter_child_nodes(node):
            name = prefix
            if isinstance(child, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                name = f"{prefix}.{child.name}".removeprefix(".")
                found.add(name)
            nodes.append((name, child))
    return found
