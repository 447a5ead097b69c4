"""The parameters of navigation; some are also launch arguments."""

from dataclasses import dataclass

from onebot_description.parameters.reader import group, parameter


@dataclass(frozen=True)
class NavigationParameters:
    """Parameters of goals, with the names of Nav2's nodes."""

    xy_goal_tolerance: float = parameter(
        0.05, "distance to a goal at which it is reached, m", at_least=0.02, at_most=10.0
    )
    yaw_goal_tolerance: float = parameter(
        0.1, "heading error at which a goal is reached, rad", at_least=0.01, at_most=3.2
    )
    controller_frequency: float = parameter(
        20.0, "commands per second, Hz", at_least=2.0, at_most=100.0
    )
    resolution: float = parameter(0.05, "edge of the map's cells, m", at_least=0.01, at_most=1.0)
    time_allowance: float = parameter(
        0.0, "maximum time for a goal, s; 0: no limit", at_least=0.0, at_most=1e6
    )


@dataclass(frozen=True)
class InitialPose:
    """The start pose in the map."""

    x: float = parameter(0.0, "start position in the map, m", at_least=-1e6, at_most=1e6)
    y: float = parameter(0.0, "start position in the map, m", at_least=-1e6, at_most=1e6)
    yaw: float = parameter(0.0, "start heading in the map, rad", at_least=-1e6, at_most=1e6)


@dataclass(frozen=True)
class NavigatorParameters(NavigationParameters):
    """The parameters of the navigator."""

    yaml_filename: str = parameter(
        "", "map file of map_server to localize in; empty: build a map from scans"
    )
    global_frame: str = parameter("map", "the frame of the map", read_only=True)
    initial_pose: InitialPose = group(InitialPose)
    stop_on_failure: bool = parameter(
        False, "whether to stop at the first waypoint that cannot be reached; else it is skipped"
    )
