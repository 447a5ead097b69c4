"""``onebot steer``: a page in the browser to steer a robot from, with its view beside it."""

import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from onebot_bringup.bringup import environment
from onebot_bringup.cli.ros_session import Session
from onebot_bringup.launcher import Launcher, Node, OnExit, python_node
from onebot_bringup.launcher.arguments import (
    Argument,
    UsageError,
    complete,
    refuse_positional,
    split,
    switch,
    table,
)
from onebot_bringup.launcher.parameter_files import write_parameters
from onebot_bringup.steering.access import check_host, is_loopback, new_token
from onebot_description.errors import OneBotError

_TOPIC = "velocity_controller/cmd_vel"
_VIEWER = "steering_viewer"  # not rerun_viewer: the robot may get one of its own later
_ARGUMENTS = [
    Argument("topic", _TOPIC, "to steer, Twist or TwistStamped; the page can change it"),
    Argument("odom_topic", "", "the odometry to show; empty: the robot's own"),
    Argument("host", "127.0.0.1", "where the page is served; 0.0.0.0: to other computers, too"),
    Argument("port", "8080", "of the page; another if it is in use, 0: any"),
    Argument("token", "", "asked for in the page's address; made anew if others can reach it"),
    Argument("rate", "20.0", "commands a second, Hz, 5 to 100"),
    Argument("max_linear", "0.0", "the most to ask for, m/s; 0: what the controller allows"),
    Argument("max_angular", "0.0", "the most to ask for, rad/s; 0: what the controller allows"),
    Argument(
        "viewer",
        "auto",
        "the robot's view; auto: its own, or else one is started",
        ("auto", "web", "none"),
    ),
    Argument("view", "", "what a viewer started here shows and from where, a YAML file"),
    switch("open_browser", True, "open the page, if there is a display"),
    Argument("namespace", "", "the namespace of all nodes"),
    Argument("domain_id", "", "ROS_DOMAIN_ID, 0 to 232; empty: the environment's"),
    Argument(
        "discovery",
        "localhost",
        "who sees the nodes; ROS_AUTOMATIC_DISCOVERY_RANGE goes before this default",
        ("localhost", "subnet"),
    ),
]
_NUMBERS = {
    "rate": (5.0, 100.0),
    "max_linear": (0.0, 1e6),
    "max_angular": (0.0, 1e6),
}
_WHOLE = {"port": 65535, "domain_id": 232}
_HELP = f"""usage: onebot steer [TOPIC] [name:=value ...] [--ros-args ...]

Serves a page to steer a robot from, and prints its address. Hold the pad (mouse or finger), an
arrow key, a slider or a gamepad's stick, and the robot drives; let go, and it stops. So it does
when the page loses the focus, is closed or loses its connection. The space bar stops it at once.
Of several pages, the last to take hold drives.

From another computer: ssh -L 8080:127.0.0.1:8080 THIS_COMPUTER, and open http://127.0.0.1:8080
there; or host:=0.0.0.0, and open the whole address that is printed, with its token.

Arguments and their defaults:
{table(_ARGUMENTS)}

--ros-args goes to every node. Ctrl-C stops everything. Exit codes: 0 stopped by the user, 1 a file
is wrong or a node failed, 2 the command line is wrong."""


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code.

    Raises:
        UsageError: the command line is wrong.
        OneBotError: a file or a name is.
    """
    arguments = split(argv)
    refuse_positional(arguments.positional[1:])
    if arguments.positional and "topic" in arguments.given:
        raise UsageError("write the topic or topic:=, not both, for onebot steer")
    if arguments.help or arguments.show:
        print(_HELP if arguments.help else table(_ARGUMENTS))
        return 0
    topic = dict(zip(["topic"], arguments.positional, strict=False))
    given = {**topic, **arguments.given}
    values = complete(_ARGUMENTS, given)
    _check(values)
    values["token"] = _token(values)
    os.environ.update(environment(values, forced="discovery" in given))
    with tempfile.TemporaryDirectory(prefix="onebot-") as folder:
        return _launch(Path(folder), values, arguments.ros_args)


def _launch(folder: Path, values: Mapping[str, str], ros_args: Sequence[str]) -> int:
    own = _needs_viewer(values, ros_args)
    page: dict[str, object] = {
        name: values[name] for name in ("topic", "odom_topic", "host", "token")
    }
    page |= {name: float(values[name]) for name in _NUMBERS}
    page |= {"port": int(values["port"]), "open_browser": values["open_browser"] == "true"}
    page["viewer_page"] = f"{_VIEWER if own else 'rerun_viewer'}/page"
    make = _Nodes(folder, values["namespace"].strip("/"), ros_args)
    nodes = [make.node("steering_page", "onebot_bringup.steering_page", page, "shutdown")]
    if own:
        view: dict[str, object] = {"viewer": "web", "view": values["view"], "open_browser": False}
        view |= {"grpc_port": 0, "web_port": 0}
        nodes.append(make.node(_VIEWER, "onebot_bringup.rerun_viewer", view, "ignore"))
    hint = "steering_page prints the page's address; Ctrl-C stops everything"
    return Launcher(nodes, name="onebot steer", started_message=hint, temporary=[folder]).run()


class _Nodes:
    """Makes nodes whose parameters are written to files."""

    def __init__(self, folder: Path, namespace: str, ros_args: Sequence[str]) -> None:
        self._folder, self._namespace, self._ros_args = folder, namespace, ros_args

    def node(
        self, name: str, module: str, parameters: Mapping[str, object], on_exit: OnExit
    ) -> Node:
        file = write_parameters(self._folder, name, parameters, self._namespace)
        arguments = ["--ros-args", "--params-file", str(file), "-r", f"__node:={name}"]
        if self._namespace:
            arguments += ["-r", f"__ns:=/{self._namespace}"]
        return python_node(name, module, [*arguments, *self._ros_args], on_exit=on_exit)


def _needs_viewer(values: Mapping[str, str], ros_args: Sequence[str]) -> bool:
    """Say whether to start a viewer; look around for the robot's own first, if need be."""
    words = ["--ros-args", *ros_args, *_namespace_words(values["namespace"])]
    with Session(words) as session:
        for name in ("topic", "odom_topic"):
            if values[name]:
                session.full_name(values[name])
        if values["viewer"] != "auto":
            return values["viewer"] == "web"
        from rclpy.qos import DurabilityPolicy, QoSProfile
        from std_msgs.msg import String

        pages: list[String] = []
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        session.node.create_subscription(String, "rerun_viewer/page", pages.append, latched)
        found = session.look_for(
            lambda: any(_answers(page.data) for page in pages),
            "the robot's view, a rerun_viewer with a page",
        )
    if not found:
        print("there is none: starting one")
    return not found


def _answers(address: str) -> bool:
    """Say if a viewer's page is there, and not only its last word on the topic."""
    from onebot_bringup.steering.view_proxy import View
    from onebot_bringup.viewer.processes import answers

    view = View.parse(address)
    return view is not None and answers(view.page_port)


def _token(values: Mapping[str, str]) -> str:
    """Return the token given, or one made anew if it is needed, for as long as we run.

    Raises:
        OneBotError: the host is no address of this computer.
    """
    check_host(values["host"])
    return values["token"] or ("" if is_loopback(values["host"]) else new_token())


def _namespace_words(namespace: str) -> list[str]:
    """Return the ROS arguments that put a node there."""
    from rclpy.exceptions import InvalidNamespaceException
    from rclpy.validate_namespace import validate_namespace

    full = f"/{namespace.strip('/')}"
    try:
        validate_namespace(full)
    except InvalidNamespaceException as error:
        reason = " ".join(str(error).split("\n")[0].split())
        raise UsageError(f"namespace:={namespace}: {reason}") from None
    return ["-r", f"__ns:={full}"] if full != "/" else []


def _check(values: Mapping[str, str]) -> None:
    """Complain about values that are not possible.

    Raises:
        UsageError: there is one.
        OneBotError: the view's file does not exist.
    """
    for name, (least, most) in _NUMBERS.items():
        try:
            possible = least <= float(values[name]) <= most
        except ValueError:
            possible = False
        if not possible:
            raise UsageError(f"{name}:={values[name]}: write a number from {least:g} to {most:g}")
    for name, highest in _WHOLE.items():
        text = values[name]
        if text and not (text.isdecimal() and int(text) <= highest):
            raise UsageError(f"{name}:={text}: write a whole number from 0 to {highest}")
    if not values["port"] or not values["topic"]:
        raise UsageError(f"{'topic' if values['port'] else 'port'}:= must not be empty")
    if values["view"] not in ("", "none") and not Path(values["view"]).is_file():
        raise OneBotError(f"view:={values['view']}: no such file")
    if values["view"] and values["viewer"] == "none":
        raise UsageError("viewer:=none shows nothing, so leave out view:=")
