"""What the mutation run mutates, the tests that must notice, and the mutants that no test can."""

import ast
import functools
from pathlib import Path

CHECKOUT = Path(__file__).parents[2]


def _tests(package: str, *names: str) -> tuple[str, ...]:
    return tuple(f"tests/{package}/test_{name}.py" for name in names)


def _control(*names: str) -> tuple[str, ...]:
    return _tests("onebot_control", *names)


def _description(*names: str) -> tuple[str, ...]:
    return _tests("onebot_description", *names)


_SIMULATION = ("simulation_loading", "simulation_state", "simulation_motion")
_CHECKS = (
    *("description_checks", "description_sizes", "description_problems"),
    *("description_faults", "description_loading"),
)
_SOURCE = ("joints_source", "joints_mimic")
_READER = ("parameters_reader", "parameters_values")

# Each module of a pure core with the test files that test it, the quickest first. Few tests
# in them make a node, and none a process of one.
TESTS: dict[str, tuple[str, ...]] = {
    "onebot_control/drive/speed_limiter.py": _control("speed_limiter"),
    "onebot_control/drive/odometry.py": _control("odometry"),
    "onebot_control/drive/diff_drive.py": _control("diff_drive"),
    "onebot_control/controlled_robot.py": _control(
        "controlled_robot", "fleet", "joint_state_broadcaster", "drift_check"
    ),
    "onebot_control/fleet.py": _control("fleet", "control_loop"),
    "onebot_control/frame_names.py": _control("frame_names"),
    "onebot_control/nodes/control_loop.py": _control("control_loop"),
    "onebot_control/drive/wheels/finding.py": _control("wheels_finding", "wheels_geometry"),
    "onebot_control/drive/wheels/geometry.py": _control("wheels_geometry"),
    "onebot_control/drive/parameters.py": (
        *_control("control_config"),
        "tests/test_readme_tables.py",
    ),
    "onebot_control/control_files.py": _control("control_files"),
    "onebot_control/physics/physics_urdf.py": _control("simulation_bodies", *_SIMULATION),
    "onebot_control/physics/rest_pose.py": _control("simulation_settling", "scene", *_SIMULATION),
    "onebot_control/physics/scene.py": _control("scene"),
    "onebot_control/physics/physics_settings.py": _control("simulation_values", "world"),
    "onebot_description/joints/chains.py": _description("joints_mimic", "robot_model"),
    "onebot_description/joints/config.py": _description("joints_config", "joints_source"),
    "onebot_description/joints/motions.py": _description(
        "joints_tracks", "joints_violations", *_SOURCE
    ),
    "onebot_description/joints/motion_limits.py": _description("joints_limits"),
    "onebot_description/joints/mimic.py": _description(*_SOURCE),
    "onebot_description/joints/plan.py": _description(*_SOURCE),
    "onebot_description/joints/source.py": _description(*_SOURCE),
    "onebot_description/description/checks.py": _description(*_CHECKS),
    "onebot_description/elements/reading.py": _description(*_CHECKS),
    "onebot_description/description/expressions.py": _description("expressions"),
    "onebot_description/description/expansion.py": _description("expressions", *_CHECKS),
    "onebot_description/description/xacro.py": _description("xacro_arguments", *_CHECKS),
    "onebot_description/geometry/matrices.py": _description("quaternions"),
    "onebot_description/geometry/poses.py": _description("poses", "quaternions"),
    "onebot_description/geometry/quaternions.py": _description("quaternions"),
    "onebot_description/model/rigid_bodies.py": _control("simulation_bodies", *_SIMULATION),
    "onebot_description/model/robot_model.py": _description("robot_model"),
    "onebot_description/ros/parameters/reader.py": (
        *_description(*_READER),
        "tests/test_readme_tables.py",
    ),
    "onebot_description/ros/parameters/values.py": _description(*_READER, "discovery"),
    "onebot_bringup/launch/arguments.py": _tests(
        "onebot_bringup", "launcher_arguments", "robots", "bringup_nodes"
    ),
}


# Mutants that behave as the code does, by module: the definition ("Class.method", "function", "" at
# the module's level), and the line that the printed diff adds, or removes when it adds none.
EQUIVALENT: dict[str, set[str]] = {
    "onebot_bringup/launch/arguments.py": {
        # Without rows there is nothing as wide.
        "table: width = min(max((len(left) for left, _ in rows), default= -1), 34)",
    },
    "onebot_control/nodes/control_loop.py": {
        # Deadlines that nothing comes near, and a delay that a busy machine has, too.
        ": _PATIENCE = 11.0  # s to wait for the end of the loop",
        ": _PATIENCE = 9.0  # s to wait for the end of the loop",
        ": _LONGEST_WAIT = 1.1  # s between checks whether anything was posted",
        # More or fewer comparisons find an exact one, too.
        ": _COMPARISONS = 9  # comparisons of the clocks at the start; the most exact one is used",
        ": _COMPARISONS = 11  # comparisons of the clocks at the start; the most exact one is used",
        # ``start`` sets it.
        "ControlLoop.__init__: self.fleet, self.simulated, self.paused = fleet, simulated, True",
        # All robots of a world have one pace.
        "ControlLoop.start: config = self.fleet.robots[ -1].config",
        # Every stamp is after 1970.
        "SystemStamps.__init__: self._last = 1  # 1970, before every stamp",
        "SystemStamps.__init__: self._last = -1  # 1970, before every stamp",
        # Clocks do not stop at this very moment.
        "ControlLoop._wait: if left < 0.0:",
        "ControlLoop._wait_for_missing: if left < 0.0 or self._stopped:",
        "SystemStamps.at: if self._last - _SET_BACK <= stamp:",
        # No period is below 0.
        "Pacer.next: if 0.0 != self._interval <= now - self.due:  # the wait may have changed the pace",  # noqa: E501
    },
    "onebot_control/controlled_robot.py": {
        # No cycle has such a number.
        "ControlledRobot.teleport: self._observed = - 2",
        "ControlledRobot.start: self.ticks, self._observed = 0, - 2",
        # There are two wheels at least, and as many on either side.
        "ControlledRobot.start: self.drift = DriftCheck(skids=self.wheels is not None and len(self.wheels.names) != 2)",  # noqa: E501
        "ControlledRobot.start: self.drift = DriftCheck(skids=self.wheels is not None and len(self.wheels.names) > 3)",  # noqa: E501
        # 0, divided by whatever.
        "Side.mean: count = len(self._rows) or 2",
    },
    "onebot_control/drive/odometry.py": {
        # The wheels' first positions only begin: the time before them counts for nothing.
        "Odometry.__init__: self._since = -1.0",
    },
    "onebot_control/physics/physics_urdf.py": {
        # No moment is exactly that.
        "_principal: if moments.min() <= 0 or moments[greatest] >= sum_of_others * (1 + _ROUNDING):",  # noqa: E501
        "_principal: if moments.min() <= 0 or moments[greatest] >= sum_of_others * (1 + _REPAIRED):",  # noqa: E501
        # Less than rounding lifts it.
        "_principal: moments[greatest] = min(moments[greatest], sum_of_others * (1 + 1e-9))",
        # A mass below 0 is refused before.
        "_principal: if body.mass == 0:",
        # Below the lower limit, however far.
        'physics_urdf: slide = replace(joint, kind="prismatic", lower=1.0, upper=- 2.0)',
    },
    "onebot_control/physics/rest_pose.py": {
        # The ground is level and has no end.
        "settle: robot.place(((0.0, 1.0, -lowest), (0.0, 0.0, 0.0, 1.0)))",
        "settle: robot.place(((0.0, -1.0, -lowest), (0.0, 0.0, 0.0, 1.0)))",
        "settle: robot.place((( 1.0, 0.0, -lowest), (0.0, 0.0, 0.0, 1.0)))",
        "settle: robot.place((( -1.0, 0.0, -lowest), (0.0, 0.0, 0.0, 1.0)))",
        "_standing: robot.place(rest_pose.at(0.0, 1.0, 0.0))",
        "_standing: robot.place(rest_pose.at(0.0, -1.0, 0.0))",
        "_standing: robot.place(rest_pose.at( 1.0, 0.0, 0.0))",
        "_standing: robot.place(rest_pose.at( -1.0, 0.0, 0.0))",
        "settle: near = bullet.getClosestPoints(robot.body, robot.ground, 1000000001.0)",
        "settle: near = bullet.getClosestPoints(robot.body, robot.ground, 999999999.0)",
        "_standing: base = robot.bullet.getClosestPoints(robot.body, robot.ground, 1000000001.0, linkIndexA=-1)",  # noqa: E501
        "_standing: base = robot.bullet.getClosestPoints(robot.body, robot.ground, 999999999.0, linkIndexA=-1)",  # noqa: E501
        # One step more of a robot at rest.
        "_come_to_rest: if rested > needed:",
        "_come_to_rest: rested = rested + 1 if _fastest(robot) <= _RESTING else 0",
        # What is not deep has no name.
        '_warn_of_obstacles: depth, index, obstacle = max(near, default=(0.0, 1, ""))',
        '_warn_of_obstacles: depth, index, obstacle = max(near, default=(0.0, - 0, ""))',
        '_warn_of_obstacles: depth, index, obstacle = max(near, default=(0.0, - 2, ""))',
        '_warn_of_obstacles: depth, index, obstacle = max(near, default=( -1.0, -1, ""))',
        # The base was lifted by half of that.
        "_base_touches: for point in robot.bullet.getClosestPoints(robot.body, body, 3.0 * _ABOVE, linkIndexA=-1)",  # noqa: E501
        "_base_touches: point[7][2] >= 0.0  # the normal, towards the robot",
        # What diverges turns and moves without end at once.
        "_check_rest: if not math.isfinite(sum(position) / sum(rotation)):",
        # One step more of a robot at rest.
        "_come_to_rest: needed, rested = math.ceil(_RESTING_TIME * settings.rate), -1",
        "_come_to_rest: rested = -1",
        # It counts in steps of one, and from 0 when it was reached.
        "_come_to_rest: if rested == needed:",
    },
    "onebot_control/physics/scene.py": {
        # PyBullet wakes the whole body, whichever link is named.
        "SceneBodies._activate: self._bullet.changeDynamics(part.body, - 2, activationState=state)",
        "SceneBodies._activate: self._bullet.changeDynamics(part.body, - 0, activationState=state)",
        # What is not reached is less than 0 deep, which is not deep, either.
        "SceneBodies._depth: near = self._bullet.getClosestPoints(one, other, 1.0)",
        "SceneBodies._depth: return max((-point[8] for point in near), default= -1.0)",
        # A mass below 0 is refused before.
        "SceneBodies._joint_problems: if not any(link.inertial and link.inertial.mass != 0 for link in links):",  # noqa: E501
        # No depth is exactly that.
        "SceneBodies._overlaps: return self._depth(robot.body, body) >= _DEPTH",
        "SceneBodies._overlap_problems: if (depth := max(self._depth(part.body, body) for body in bodies)) >= _DEEPEST:",  # noqa: E501
        # What is not finite stays so.
        "SceneBodies.read: self.finite = math.isfinite(sum(sum(at) / sum(turn) for at, turn in self.poses))",  # noqa: E501
        "SceneBodies.read: self.finite = math.isfinite(sum(sum(at) - sum(turn) for at, turn in self.poses))",  # noqa: E501
        "SceneBodies.read: self.finite = math.isfinite(sum(sum(at) * sum(turn) for at, turn in self.poses))",  # noqa: E501
        # It is read again when the bodies enter a world.
        "SceneBodies.__init__: self.finite = False",
    },
    "onebot_control/drive/wheels/finding.py": {
        # Without wheels there is no ground to be on.
        "_on_ground: ground = min((wheel.bottom for wheel in wheels), default= -1.0)",
        # The axis is that of a wheel, and so has neither x nor z but for a degree.
        "_is_steered: x, y, _ = np.cross(axle.axis, (0.0, -1.0, 1.0))",
        "_is_steered: trail = x * (wheel.x - swivel.pose[0, 3]) + y * (wheel.y - swivel.pose[ 0, 3])",  # noqa: E501
        # There are as many on either side.
        "find_wheels: if len(drive) > 3 and all(_has_rollers(description, wheel) for wheel in drive):",  # noqa: E501
        # A sum of 0 is 0 with the other sign.
        "_sets: return [group for group in sets if sum(1 if not wheel.y > 0.0 else -1 for wheel in group) == 0]",  # noqa: E501
    },
    "onebot_control/drive/wheels/geometry.py": {
        # No two radii differ by exactly that.
        "Wheels.radius: if max(radii.values()) - min(radii.values()) >= _SAME:",
        # The iteration has long converged, wherever it began.
        "skid_separation: turning, slip = 1.0, across  # x of the point; m/s at a wheel for 1 rad/s: any will do",  # noqa: E501
        "skid_separation: turning, slip = -1.0, across  # x of the point; m/s at a wheel for 1 rad/s: any will do",  # noqa: E501
        ": _STEPS = 199  # fixed-point iterations; four equal loads need one",
        # There is one wheel on either side at least.
        "Wheels.separation: if len(self.left) <= 1:",
    },
    "onebot_description/description/checks.py": {
        # With no spread, any angle will do.
        "_principal_moments: cosine = determinant / (2 * spread**3) if spread > 1e-12 else 2.0",
        "_principal_moments: cosine = determinant / (2 * spread**3) if spread > 1e-12 else 0.0",
        "_principal_moments: cosine = determinant / (2 * spread**3) if spread >= 1e-12 else 1.0",
        # A count is 1 at least.
        "_check_repeats: if count != 1 and tag in _SINGLE:",
    },
    "onebot_description/description/expansion.py": {
        # The search begins at 0 at least, and goes on from there.
        "_Children: _last = 1",
        # The number is not shown.
        '_Run.parse: raise xacro.XacroException("", exc=FileNotFoundError( 3, "no such file", str(path)))',  # noqa: E501
        '_Run.parse: raise xacro.XacroException("", exc=FileNotFoundError( 1, "no such file", str(path)))',  # noqa: E501
        # The search begins at 0 at least.
        "_Children: _last = -1",
        # What is not found from there on is searched for from the beginning.
        "_Children.index: self._last = super().index(node, max(self._last - 2, 1))",
        # There is at least one place.
        'written_at: calls = f" (called at {\', from \'.join(places[1:])})" if len(places) != 1 else ""',  # noqa: E501
    },
    "onebot_description/elements/reading.py": {
        # No angle in a file is exactly that.
        "_radians: if degrees >= _TURN:",
        # Nothing is less than a turn.
        "_radians: degrees = max(map(abs, values), default= 1.0)",
        "_radians: degrees = max(map(abs, values), default= -1.0)",
        # It checks attributes of one number.
        "_not_negative: return values[ -1] >= 0",
    },
    "onebot_description/joints/motion_limits.py": {
        # NumPy takes any number below 0 for the rest.
        "joint_limits: ranges = np.array([_range(joint, soft, problems) for joint in joints]).reshape(- 2, 2)",  # noqa: E501
    },
    "onebot_description/joints/motions.py": {
        # The times begin at 0 or later.
        "Keyframes.violations: if self.loop and abs(gap) > _WHOLE_TURN and times[-1] != 0.0:",
    },
    "onebot_description/joints/plan.py": {
        # What follows another joint has no motion of its own.
        "make_plan: motion = Keyframes.hold( -1.0) if follows[row] else planner.motion(zero, bool(endless[row]))",  # noqa: E501
        "make_plan: motion = Keyframes.hold( 1.0) if follows[row] else planner.motion(zero, bool(endless[row]))",  # noqa: E501
        # Both are finite, or neither sum nor difference is.
        "_JointPlanner._swing: if math.isfinite(upper + lower):",
        # A range is never below 0.
        "_JointPlanner._swing: if amplitude != 0.0:",
    },
    "onebot_description/joints/source.py": {
        # The position is the same either way but for rounding.
        "JointStateSource._toward: near = np.abs(way) <= reach / (1.0 + _ROUNDING)",
        "JointStateSource._toward: near = np.abs(way) <= reach - (1.0 + _ROUNDING)",
        "JointStateSource._toward: near = np.abs(way) <= reach * (1.0 - _ROUNDING)",
        # No value is exactly that.
        "ReceivedJointStates.receive: if number is not None and abs(value) < LARGEST:",
        # The position is the same either way but for rounding.
        "JointStateSource._toward: near = np.abs(way) < reach * (1.0 + _ROUNDING)",
    },
    "onebot_description/geometry/quaternions.py": {
        # No length is below 0.
        "normalized: unit = rotation / np.where(length != 0.0, length, 1.0)",
        "normalized: return np.where(length != 0.0, unit, (0.0, 0.0, 0.0, 1.0))",
        # Zeros, divided by whatever.
        "normalized: unit = rotation / np.where(length > 0.0, length, 2.0)",
    },
    "onebot_description/model/robot_model.py": {
        # NumPy takes any number below 0 for the rest.
        "LinkTree.__init__: columns = np.array(steps, np.int32).reshape(- 2, 3).T.copy()",
        # No position is exactly that.
        "RobotModel.pose: within = (positions > self.lower - _SLACK) & (positions <= self.upper + _SLACK)",  # noqa: E501
        "RobotModel.pose: within = (positions >= self.lower - _SLACK) & (positions < self.upper + _SLACK)",  # noqa: E501
    },
    "onebot_description/ros/parameters/reader.py": {
        # One problem more or less of many.
        ": _MOST_LISTED = 49  # problems in one message",
        ": _MOST_LISTED = 51  # problems in one message",
        # It is compared with the most that are listed.
        "_no_such: def _no_such(shape: _Shape, name: str, number: int = 1) -> str:",
        # It is compared with the most that are listed.
        "_no_such: def _no_such(shape: _Shape, name: str, number: int = -1) -> str:",
    },
    "onebot_description/ros/parameters/values.py": {
        # No set has more elements than the list.
        "ValueType._list: if self.rule.unique and len(set(items)) != len(items):",
        # The same number: one more or less is not to be seen in it.
        ": LARGEST = 1e+60",
    },
    "onebot_control/fleet.py": {
        # All robots of a world have one rate.
        "Fleet.rate: return self.robots[ -1].config.update_rate",
        "Fleet.period: return self.robots[ -1].period",
        "Fleet.ticks: return self.robots[ -1].ticks",
        "Fleet.from_members: world = World(spawns, _settings(members[ -1].config.update_rate, spawns), scene)",  # noqa: E501
        # One iteration in a thousand.
        ": _ARM_ITERATIONS = 1001",
        ": _ARM_ITERATIONS = 999",
        # The phase is not exactly there.
        "Divider.due: picked = self._phase > 1.0 - 1e-9",
    },
    "onebot_control/drive/diff_drive.py": {
        # The pace of whole cycles is 1, computed or not, and no cycle is longer than its time.
        "DiffDriveController._pass: if self.pace < 2.0 or cycle < seconds:",
        "DiffDriveController._pass: if self.pace <= 1.0 or cycle < seconds:",
        "DiffDriveController._pass: if self.pace != 1.0 or cycle < seconds:",
        "DiffDriveController._pass: if self.pace < 1.0 or cycle != seconds:",
        "DiffDriveController._pass: if self.pace < 1.0 or cycle <= seconds:",
    },
    "onebot_description/geometry/matrices.py": {
        # Zeros, divided by whatever.
        "of_transform: length = math.hypot(x, y, z, w) or 2.0",
    },
    "onebot_control/drive/speed_limiter.py": {
        # At a limit, the value is the limit.
        "clamp: return lower if value <= lower else upper if value > upper else value",
        "clamp: return lower if value < lower else upper if value >= upper else value",
    },
}


def missing() -> list[str]:
    """Return what the tables name and the checkout does not have: they follow every move."""
    named = {*TESTS, *(file for files in TESTS.values() for file in files)}
    named.update(EQUIVALENT)
    lost = {path for path in named if not (CHECKOUT / path).is_file()}
    for module, mutants in EQUIVALENT.items():
        for definition in {mutant.split(": ")[0] for mutant in mutants}:
            if module not in lost and definition not in _definitions(module):
                lost.add(f"{module}: {definition}")
    return sorted(lost)


@functools.cache
def _definitions(module: str) -> set[str]:
    """Return the names of a module's functions and classes, such as "Class.method", and ""."""
    names = {""}
    nodes: list[tuple[str, ast.AST]] = [("", ast.parse((CHECKOUT / module).read_text("utf-8")))]
    while nodes:
        prefix, node = nodes.pop()
        for child in ast.iter_child_nodes(node):
            name = prefix
            if isinstance(child, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                name = f"{prefix}.{child.name}".removeprefix(".")
                names.add(name)
            nodes.append((name, child))
    return names
