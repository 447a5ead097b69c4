"""The parameters of navigation; some of them are launch arguments, too."""

from dataclasses import dataclass

from onebot_description.parameters.reader import group, parameter


@dataclass(frozen=True)
class NavigationParameters:
    """How goals are reached; the names are those of Nav2's nodes."""

    xy_goal_tolerance: float = parameter(
        0.05, "distance from a goal at which it is reached, m", at_least=0.02, at_most=10.0
    )
    yaw_goal_tolerance: float = parameter(
        0.1, "likewise the difference of heading, rad", at_least=0.01, at_most=3.2
    )
    controller_frequency: float = parameter(
        20.0, "commands per second, Hz", at_least=2.0, at_most=100.0
    )
    resolution: float = parameter(0.05, "edge of the map's cells, m", at_least=0.01, at_most=1.0)
    time_allowance: float = parameter(
        0.0, "longest time for a goal, s; 0: no limit", at_least=0.0, at_most=1e6
    )


@dataclass(frozen=True)
class InitialPose:
    """Where the robot starts in the map."""

    x: float = parameter(0.0, "where the robot starts in the map, m", at_least=-1e6, at_most=1e6)
    y: float = parameter(0.0, "likewise, m", at_least=-1e6, at_most=1e6)
    yaw: float = parameter(0.0, "its heading there, rad", at_least=-1e6, at_most=1e6)


@dataclass(frozen=True)
class NavigatorParameters(NavigationParameters):
    """The parameters of the navigator."""

    yaml_filename: str = parameter(
        "", "a map to localize in, as map_server saves it; empty: the scans make one"
    )
    global_frame: str = parameter("map", "the frame of the map", read_only=True)
    initial_pose: InitialPose = group(InitialPose)
    stop_on_failure: bool = parameter(
        False, "whether waypoints end at the first that cannot be reached; else it is left out"
    )
