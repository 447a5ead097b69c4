"""What the mutation run mutates, and the tests that must notice."""

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
    *("description_checks", "description_unit_check", "description_problems"),
    *("description_faults", "description_loading"),
)
_LAUNCH = ("launcher_arguments", "robots", "bringup_nodes")
_SOURCE = ("joints_source", "joints_mimic")
_READER = ("parameters_reader", "parameters_values")

# Each module of a pure core with the test files that test it, the quickest first. Few tests
# in them make a node, and none a process of one.
TESTS: dict[str, tuple[str, ...]] = {
    "onebot_control/drive/speed_limiter.py": _control("speed_limiter"),
    "onebot_control/drive/odometry.py": _control("odometry"),
    "onebot_control/drive/drive.py": _control("diff_drive"),
    "onebot_control/drive/kinematics.py": _control("odometry"),
    "onebot_control/drive/diff_drive.py": _control("odometry", "control_config"),
    "onebot_control/controlled_robot.py": _control(
        "controlled_robot", "fleet", "joint_state_broadcaster", "drift_check"
    ),
    "onebot_control/fleet.py": _control("fleet", "control_loop"),
    "onebot_control/conventions.py": _control("conventions"),
    "onebot_control/runtime/control_loop.py": _control("control_loop"),
    "onebot_control/runtime/pacing.py": _control("pacing"),
    "onebot_control/drive/wheels/finding.py": _control("wheels_finding", "wheels_geometry"),
    "onebot_control/drive/wheels/geometry.py": _control("wheels_geometry"),
    "onebot_control/simulation_parameters.py": (
        *_control("control_config"),
        "tests/test_readme_tables.py",
    ),
    "onebot_control/control_files.py": _control("control_files"),
    "onebot_control/physics/physics_urdf.py": _control("simulation_bodies", *_SIMULATION),
    "onebot_control/physics/rest_pose.py": _control("simulation_settling", "scene", *_SIMULATION),
    "onebot_control/physics/scene.py": _control("scene"),
    "onebot_control/physics/engine.py": _control("simulation_values", "world"),
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
    "onebot_description/parameters/reader.py": (
        *_description(*_READER),
        "tests/test_readme_tables.py",
    ),
    "onebot_description/parameters/values.py": _description(*_READER, "discovery"),
    "onebot_bringup/launch/arguments.py": _tests("onebot_bringup", *_LAUNCH),
    "onebot_bringup/launch/settings.py": _tests("onebot_bringup", *_LAUNCH),
}


def missing() -> list[str]:
    """Return what the table names and the checkout does not have: it follows every move."""
    named = {*TESTS, *(file for files in TESTS.values() for file in files)}
    return sorted(path for path in named if not (CHECKOUT / path).is_file())
