"""The parameters of steering_page, which are also arguments of ``onebot steer`` and bringups."""

from dataclasses import dataclass
from typing import Any

from onebot_description.parameters.reader import parameter
from onebot_description.parameters.values import MAX_PORT


def _parameter(default: Any, description: str, **rules: Any) -> Any:
    return parameter(default, description, read_only=True, **rules)


@dataclass(frozen=True)
class PageParameters:
    """The parameters of the node; topics are full names, "" for none."""

    host: str = _parameter("127.0.0.1", "address of the page; 0.0.0.0: also for other computers")
    port: int = _parameter(
        8080, "port of the page; another one if it is in use; 0: any", at_least=0, at_most=MAX_PORT
    )
    token: str = _parameter("", "required in the page's address; generated if others can reach it")
    topic: str = _parameter(
        "velocity_controller/cmd_vel",
        "initial command topic, Twist or TwistStamped",
        not_empty=True,
        write="the name of the topic to steer",
    )
    odom_topic: str = _parameter("", "the odometry to show; empty: the robot's own")
    rate: float = _parameter(20.0, "commands per second, Hz", at_least=5.0, at_most=100.0)
    max_linear: float = _parameter(
        0.0, "limit of commands, also sideways, m/s; 0: the controller's limit", at_least=0.0
    )
    max_angular: float = _parameter(
        0.0, "limit of commands, rad/s; 0: the controller's limit", at_least=0.0
    )
    viewer_page: str = _parameter("rerun_viewer/page", "the topic with the address of the view")
    await_view: float = _parameter(
        0.0, "seconds to wait for the view before the address is printed", at_least=0.0
    )
    open_browser: bool = _parameter(True, "open the page, if there is a display")
