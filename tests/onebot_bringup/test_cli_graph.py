"""``onebot node, param, service, interface``, on real DDS, in the forms that ros2 prints."""

import math
from pathlib import Path

import pytest
import yaml
from rcl_interfaces.msg import (
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool

from onebot_bringup.introspection.parameter_values import DOUBLE, INTEGER, STRING, parse_value
from onebot_description.errors import OneBotError
from tests.onebot_bringup.cli_support import onebot, output_of
from tests.ros_support import Peer


def with_parameters(peer: Peer) -> None:
    node = peer.node
    node.declare_parameter("rate", 10.0)
    node.declare_parameter("label", "x")
    node.declare_parameter("limits.speed", 0.5)
    node.declare_parameter("weights", [1.0, 2.0])
    node.declare_parameter("fixed", 3, ParameterDescriptor(read_only=True))
    node.add_on_set_parameters_callback(
        lambda found: SetParametersResult(
            successful=all(p.name != "rate" or p.value > 0 for p in found),
            reason="the rate is above zero",
        )
    )


def test_nodes(ros_domain: int) -> None:
    """All nodes but hidden ones; what one does, with empty lists shown as empty lines."""
    with Peer(ros_domain, "talker") as peer:
        peer.node.create_service(SetBool, "switch", lambda _, response: response)
        assert output_of("node", "list") == "/talker\n"
        assert "/_onebot_" in output_of("node", "list", "--all")
        info = output_of("node", "info", "/talker")
        assert info.startswith("/talker\n  Subscribers:\n\n  Publishers:\n    /parameter_events: ")
        assert "  Service Servers:\n    /switch: std_srvs/srv/SetBool\n" in info
        assert info.endswith("  Service Clients:\n\n  Action Servers:\n\n  Action Clients:\n\n")
        wrong = onebot("node", "info", "/talkr")
        assert wrong.returncode == 1 and 'did you mean "/talker"' in wrong.stderr


def test_param_list_get_and_dump(ros_domain: int) -> None:
    """The names, sorted; each value with its type; all as a file that ROS reads again."""
    with Peer(ros_domain, "robot") as peer:
        with_parameters(peer)
        peer.node.declare_parameter("later", Parameter.Type.DOUBLE)  # without a value
        assert output_of("param", "list").startswith(
            "/robot:\n  fixed\n  label\n  later\n  limits.speed\n  rate\n"
        )
        for words, shown in {
            "/robot weights": "Double values are: array('d', [1.0, 2.0])",
            "robot rate --hide-type": "10.0",
            "/robot later": "Parameter not set.",
        }.items():
            assert output_of("param", "get", *words.split()) == f"{shown}\n"
        text = output_of("param", "dump", "/robot")
        assert text.startswith("/robot:\n  ros__parameters:\n    fixed: 3\n")
        assert text.endswith("\n\n")
        values = yaml.safe_load(text)["/robot"]["ros__parameters"]
        assert values["limits"] == {"speed": 0.5} and values["weights"] == [1.0, 2.0]
        assert "later" not in values
        wrong = onebot("param", "get", "/robot", "rat")
        assert wrong.returncode == 1 and 'did you mean "rate"' in wrong.stderr


def test_param_set(ros_domain: int) -> None:
    """Values in YAML; a refusal shows its reason, exit code 1; no infinity by mistake."""
    with Peer(ros_domain, "robot") as peer:
        with_parameters(peer)
        node = peer.node
        assert output_of("param", "set", "/robot", "rate", "20") == "Set parameter successful\n"
        assert node.get_parameter("rate").value == 20.0
        refused = onebot("param", "set", "/robot", "rate", "-1e-3")
        assert refused.returncode == 1 and not refused.stdout
        # Before it may stand that discovery takes a while.
        assert refused.stderr.endswith("Setting parameter failed: the rate is above zero\n")
        field = "{parameters: [{name: rate, value: {type: 3, double_value: .inf}}]}"
        service = "/robot/set_parameters", "rcl_interfaces/srv/SetParameters"
        for words in (
            ("service", "call", *service, field),
            ("param", "set", "/robot", "rate", ".inf"),
        ):
            node.set_parameters([Parameter("rate", value=1.0)])
            refused = onebot(*words)
            assert refused.returncode == 1 and "a finite number" in refused.stderr
            assert node.get_parameter("rate").value == 1.0
            output_of(*words, "--allow-non-finite")
            assert node.get_parameter("rate").value == math.inf


def test_param_load(ros_domain: int, tmp_path: Path) -> None:
    """A file's values; its refusals with reasons."""
    file = tmp_path / "robot.yaml"
    file.write_text(
        "/**: {ros__parameters: {label: '12', absent: 1}}\n"
        "/robot: {ros__parameters: {rate: 20, limits: {speed: .inf}, weights: [3, 4], fixed: 4}}\n"
    )
    with Peer(ros_domain, "robot") as peer:
        with_parameters(peer)
        node = peer.node
        infinite = onebot("param", "load", "/robot", str(file))
        assert infinite.returncode == 1 and "limits.speed is a finite number" in infinite.stderr
        loaded = onebot("param", "load", "/robot", str(file), "--allow-non-finite")
        assert loaded.returncode == 1  # two are refused
        assert loaded.stdout == "".join(
            f"Set parameter {name} successful\n"
            for name in ("label", "rate", "limits.speed", "weights")
        )
        for name in ("absent", "fixed"):
            assert f"Set parameter {name} failed: " in loaded.stderr
        assert node.get_parameter("rate").value == 20.0
        assert list(node.get_parameter("weights").value) == [3.0, 4.0]
        assert node.get_parameter("label").value == "12"
        other = onebot("param", "load", "/robot", str(file.parent / "none.yaml"))
        assert other.returncode == 1 and "none.yaml: cannot be read" in other.stderr


@pytest.mark.parametrize(
    ("text", "declared", "expected"),
    [
        ("1", 0, (INTEGER, 1)), ("1", DOUBLE, (DOUBLE, 1.0)), ("1", STRING, (STRING, "1")),
        ("true", STRING, (STRING, "true")), ("'1'", 0, (STRING, "1")),
        ("'1'", STRING, (STRING, "1")),
        ("-1e-3", 0, (DOUBLE, -0.001)), ("a: b", 0, (STRING, "a: b")), ("{", 0, (STRING, "{")),
        ("true", 0, (1, True)), ("[1, 2.5]", 0, (8, [1.0, 2.5])), ("[true]", 0, (6, [True])),
        ("[a, b]", 0, (9, ["a", "b"])), ("[]", 8, (8, [])), ("[1, 2]", 8, (8, [1.0, 2.0])),
        ("", 0, (STRING, "")), ("/ns/topic", 0, (STRING, "/ns/topic")), ("nan", 0, (STRING, "nan")),
    ],
)  # fmt: skip
def test_parameter_values(text: str, declared: int, expected: tuple[int, object]) -> None:
    """YAML's types, adapted to the type that the parameter is declared to have."""
    assert parse_value(text, declared)[1:] == expected


@pytest.mark.parametrize("text", ["[1, a]", "[true, 1]", str(2**63)])
def test_impossible_parameter_values(text: str) -> None:
    """Mixed lists and what 64 bits do not hold are refused."""
    with pytest.raises(OneBotError):
        parse_value(text)


def test_services(ros_domain: int) -> None:
    """A call prints request and response as ros2 does; a wrong type is said, not awaited."""
    with Peer(ros_domain, "robot") as peer:

        def answer(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
            response.success, response.message = request.data, "done"
            return response

        peer.node.create_service(SetBool, "/switch", answer)
        done = onebot("service", "call", "switch", "std_srvs/srv/SetBool", "{data: true}")
        assert done.returncode == 0, done.stderr
        assert done.stdout.endswith(
            "requester: making request: std_srvs.srv.SetBool_Request(data=True)\n\n"
            "response:\nstd_srvs.srv.SetBool_Response(success=True, message='done')\n\n"
        )
        wrong = onebot("service", "call", "/switch", "std_srvs/srv/Trigger")
        assert wrong.returncode == 1 and "is a std_srvs/srv/SetBool, not a" in wrong.stderr
        assert "/switch [std_srvs/srv/SetBool]\n" in output_of("service", "list", "-t")


def test_service_mistakes() -> None:
    """Types and fields are checked before anything is sent."""
    for words, hint in (
        (("std_srvs/srv/SetBol",), "std_srvs/srv/SetBool"),
        (("std_srvs/srv/SetBool", "{dat: true}"), "data"),
    ):
        done = onebot("service", "call", "/switch", *words)
        assert done.returncode == 1 and f'did you mean "{hint}"' in done.stderr


def test_interfaces() -> None:
    """The definition, nested ones indented by tabs; the list of all types."""
    assert output_of("interface", "show", "geometry_msgs/msg/Twist", "--no-comments") == (
        "Vector3  linear\n\tfloat64 x\n\tfloat64 y\n\tfloat64 z\n"
        "Vector3  angular\n\tfloat64 x\n\tfloat64 y\n\tfloat64 z\n"
    )
    service = output_of("interface", "show", "std_srvs/srv/SetBool")
    assert "bool data" in service and "\n---\n" in service
    assert "\n\tstd_msgs/Header header\n\t\t" in output_of(
        "interface", "show", "tf2_msgs/msg/TFMessage"
    )
    listed = output_of("interface", "list")
    assert "Messages:\n" in listed and "    geometry_msgs/msg/Twist\n" in listed
    assert "Services:\n" in listed and "    std_srvs/srv/SetBool\n" in listed
