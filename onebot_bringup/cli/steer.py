"""``onebot steer``: serves a page in the browser to drive a robot from, with its 3D view."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from onebot_bringup.cli.running_robots import chosen_commands, description_topics, frame_prefix
from onebot_bringup.cli.session import PATIENCE, Session
from onebot_bringup.launch.arguments import (
    NAMESPACE,
    DiscoverySettings,
    Settings,
    argument,
    field_of,
    parameter_of,
    split,
    table,
    with_positional,
)
from onebot_bringup.launch.bringup import environment
from onebot_bringup.launch.nodes import (
    AWAIT_VIEW,
    STEERING_PAGE,
    VIEWER,
    RosNodes,
)
from onebot_bringup.launcher.launcher import Launcher
from onebot_bringup.launcher.orphans import temporary_folder
from onebot_bringup.serving.ports import listen
from onebot_bringup.steering.page_parameters import PageParameters
from onebot_bringup.viewer.viewer_parameters import ViewerParameters, view_file
from onebot_control.conventions import namespace_prefix
from onebot_description.ros.names import absolute
from onebot_description.ros.signals import KeyboardInterrupts

_VIEWER = "steering_viewer"  # differs from rerun_viewer, which the robot may start later
_page = partial(parameter_of, (STEERING_PAGE.name,), PageParameters)


@dataclass(frozen=True)
class _PageSettings(Settings):
    topic: str = argument("", "command topic, or a robot such as robot2; the page can change it")
    odom_topic: str = _page("odom_topic")
    host: str = _page("host")
    port: int = _page("port")
    token: str = _page("token")
    rate: float = _page("rate")
    max_linear: float = _page("max_linear")
    max_angular: float = _page("max_angular")
    viewer: str = argument(
        "auto",
        "the 3D view; auto: the robot's viewer, or without one, or with view:=, start one",
        choices=("auto", "web", "none"),
    )
    view: str = parameter_of((_VIEWER,), ViewerParameters, "view")
    open_browser: bool = _page("open_browser")
    namespace: str = field_of(NAMESPACE)


@dataclass(frozen=True)
class SteerSettings(DiscoverySettings, _PageSettings):
    """The arguments of the command; those of discovery come last."""


_HELP = f"""usage: onebot steer [ROBOT|TOPIC] [name:=value ...] [--ros-args ...]

Serves a page to steer a robot from, and prints its address. The robot drives while you hold the
pad (mouse or finger), an arrow key, a slider or a gamepad's stick. It stops when you let go, and
when the page loses the focus, is closed or loses its connection. The space bar stops it at once.
If several pages are open, the last one that took hold drives.

From another computer: ssh -L 8080:127.0.0.1:8080 THIS_COMPUTER, and open http://127.0.0.1:8080
there; or host:=0.0.0.0, and open the whole address that is printed, with its token.

Arguments and their defaults:
{table(SteerSettings.arguments())}

--ros-args is passed to every node. Ctrl-C stops everything. Exit codes: 0 stopped by the user,
1 a file is wrong or a node failed, 2 the command line is wrong."""


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code."""
    arguments = split(argv)
    words = with_positional(arguments, "topic", "topic", "onebot steer")
    if arguments.help or arguments.show:
        print(_HELP if arguments.help else table(SteerSettings.arguments()))
        return 0
    settings = SteerSettings.read(words)
    # Mistakes are reported before anything starts.
    view_file(settings.view)
    listen(settings.host, settings.port).close()
    os.environ.update(environment(settings))
    with (
        KeyboardInterrupts(),  # Ctrl-C leaves no folder behind
        temporary_folder("launch") as folder,
    ):
        return _launch(Path(folder), settings, arguments.ros_args)


def _launch(folder: Path, settings: SteerSettings, ros_args: Sequence[str]) -> int:
    topic, view = _found(settings, ros_args)
    page = settings.parameters(STEERING_PAGE.name)
    page |= {
        "topic": topic,
        "viewer_page": f"{VIEWER.name if view is None else _VIEWER}/page",
    }
    ros_nodes, viewers = RosNodes(folder, settings.namespace, ros_args), []
    if view is not None:
        page["await_view"] = AWAIT_VIEW
        view |= settings.parameters(_VIEWER)
        view |= {"viewer": "web", "embedded": True, "grpc_port": 0, "web_port": 0}
        viewers = [ros_nodes.process(VIEWER._replace(name=_VIEWER), view)]
    nodes = [ros_nodes.process(STEERING_PAGE._replace(on_exit="shutdown"), page), *viewers]
    hint = "steering_page prints the page's address; Ctrl-C stops everything"
    return Launcher("onebot steer").run(nodes, started_message=hint)


def _found(
    settings: SteerSettings, ros_args: Sequence[str]
) -> tuple[str, dict[str, object] | None]:
    """Return the topic to steer, and the parameters of the viewer to start; None to start none.

    For ``auto``, try to discover the robot's viewer first.
    """
    space = absolute(settings.namespace)
    in_namespace = ["-r", f"__ns:={space}"] if space else []
    with Session([*ros_args, *in_namespace]) as session:
        topic = chosen_commands(session, settings.topic, first=True)
        if settings.viewer == "none":
            return topic, None
        if settings.viewer == "auto" and not settings.view and _finds_viewer(session):
            return topic, None
        return topic, robot_parameters(session)


def robot_parameters(session: Session) -> dict[str, object]:
    """Return the viewer's parameters for the robots that run in the session's namespace.

    The frames of a robot that is started later are named as by a bringup.
    """
    topics = session.spin(lambda: description_topics(session, session.space), PATIENCE)
    if len(topics) > 1:
        return {"robots": [topic.rpartition("/")[0] for topic in topics]}
    if not topics:
        return {"frame_prefix": namespace_prefix(session.space)}
    prefix = frame_prefix(session, session.publishers(topics[0]))
    return {"frame_prefix": prefix or ""}


def _finds_viewer(session: Session) -> bool:
    """Whether the robot has a viewer; prints a notice if not."""
    from std_msgs.msg import String

    from onebot_bringup.steering.view_proxy import View
    from onebot_description.ros.topic_qos import LATCHED

    pages: list[String] = []
    session.node.create_subscription(String, "rerun_viewer/page", pages.append, LATCHED)
    is_there = session.look_for(
        lambda: any(View.parse(page.data) for page in pages),
        "the robot's view, a rerun_viewer with a page",
    )
    if not is_there:
        print("no viewer found: starting one")
    return bool(is_there)
