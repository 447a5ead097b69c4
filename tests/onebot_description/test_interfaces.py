"""Classes made of a definition: the same as generated ones, for rclpy and on the wire.

Every installed message and service has a twin here, made of its definition: the two are compared.
"""

import json
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import rclpy
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.service_introspection import ServiceIntrospectionState
from std_srvs.srv import SetBool

from onebot_bringup.introspection.interfaces import installed
from onebot_description.errors import OneBotError
from onebot_description.ros.wire import message_class, type_support
from onebot_description.ros.wire.interface_text import own_interfaces
from onebot_description.ros.wire.interfaces import load_interface, make_interface
from tests.any_message import broken, messages
from tests.ros_support import Peer, node_here, spin_until

OWN = [name for kind in ("msg", "srv", "action") for name in own_interfaces(kind)]
GENERATED = [name for kind in ("msg", "srv") for name in installed(kind) if name not in OWN]

# The first half of type hashes of ROS 2 Jazzy (control_msgs 5.8.0), by its own generator. Those of
# an action or a service are of its messages, too: they are parts of its description.
HASHES = {
    "control_msgs/action/FollowJointTrajectory": "738ebcb7a2d7cfa42f9f1001cc99ce3a",
    "control_msgs/action/GripperCommand": "e17c0e644eccf14bea84a0a93e097718",
    "control_msgs/action/ParallelGripperCommand": "adfd3c1ebe8abc38ebcc0e454b6423d2",
    "control_msgs/msg/GripperCommand": "57eb8f326c9889ca8bb34ead82cc94cc",
    "control_msgs/msg/JointComponentTolerance": "739ea7566931944d33830fa10f1bf5e7",
    "control_msgs/msg/JointTolerance": "c254f9cece0f3b733017b6990fd46d13",
    "control_msgs/msg/JointTrajectoryControllerState": "51d8dd89cc624cbe9daaeeb4d80d6de9",
    "control_msgs/msg/MecanumDriveControllerState": "c560d21a4484fd5f2c05896a11de3315",
    "control_msgs/msg/SpeedScalingFactor": "0c240f349f2b74e33e8741f83e0f196d",
    "control_msgs/msg/SteeringControllerStatus": "151ec2fabdfdf10cabe982ceab9fec88",
    "control_msgs/srv/QueryTrajectoryState": "4a0935dffef18bc5b9e101c9d03d84e6",
    "control_msgs/srv/SetOdometry": "cf3fe2bf6627a67b4883ba6e876a7b46",  # of later versions
    "tf2_msgs/msg/TFMessage": "e369d0f05a23ae52508854b66f6aa043",
}


@pytest.fixture
def apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twins that a test makes are not taken for fields of other tests' classes."""
    monkeypatch.setattr(message_class, "_MADE", dict(message_class._MADE))


def described(kind: Any) -> dict[str, Any]:
    """Return the hash of a class, which is of its whole description, and its fields' defaults."""
    facts = type_support._facts(kind)
    fields = facts.description.contents.type.fields
    defaults = [field.default_value.data or b"" for field in fields.data[: fields.size]]
    return {"hash": bytes(facts.hash.value).hex(), "defaults": [text.decode() for text in defaults]}


def generated_description(name: str, share: Path = Path(sys.prefix, "share")) -> dict[str, Any]:
    """Return the same as the .json file beside a generated class has it."""
    package, kind, short = name.split("/")
    data = json.loads((share / package / kind / f"{short}.json").read_text())
    [hash_text] = [
        entry["hash_string"] for entry in data["type_hashes"] if entry["type_name"] == name
    ]
    fields = data["type_description_msg"]["type_description"]["fields"]
    defaults = [field["default_value"] for field in fields]
    return {"hash": hash_text.removeprefix("RIHS01_"), "defaults": defaults}


def parts_of(name: str, kind: Any) -> Iterator[tuple[str, Any]]:
    """List the messages of an interface."""
    if "/msg/" in name:
        yield "", kind
    else:
        yield from ((part, getattr(kind, part)) for part in ("Request", "Response", "Event"))


@pytest.mark.parametrize("name", GENERATED)
def test_a_twin_is_the_generated_type(apart: None, name: str) -> None:
    """In its description, hash and every default included, as a class, and on the wire."""
    whole = make_interface(name)
    assert described(whole) == generated_description(name)
    twins = dict(parts_of(name, whole))

    @settings(max_examples=2, suppress_health_check=list(HealthCheck), deadline=None)
    @given(st.data())
    def any_content(data: st.DataObject) -> None:
        for part, generated in parts_of(name, load_interface(name)):
            check_on_the_wire(twins[part], generated, data.draw(messages(generated)))

    for part, generated in parts_of(name, load_interface(name)):
        check_class(part, twins[part], generated)
    any_content()


def check_on_the_wire(twin: Any, generated: Any, message: Any) -> None:
    written = serialize_message(message)
    read = deserialize_message(written, twin)
    assert type(read) is twin and repr(read) == repr(message)
    again = deserialize_message(serialize_message(read), generated)
    assert repr(again) == repr(deserialize_message(written, generated))


def check_class(part: str, twin: Any, generated: Any) -> None:
    assert twin.__name__ == generated.__name__
    assert twin.__module__ == generated.__module__
    assert twin.get_fields_and_field_types() == generated.get_fields_and_field_types()
    assert twin.SLOT_TYPES == generated.SLOT_TYPES
    assert [*twin.__slots__, "_check_fields"] == list(generated.__slots__)
    assert repr(twin()) == repr(generated())
    assert twin() == twin() != generated() and twin.__hash__ is None
    names = [key for key in dir(generated) if key.isupper() and not key.endswith("__DEFAULT")]
    for key in set(names) - {"SLOT_TYPES"}:
        assert getattr(twin, key) == getattr(generated, key), key
    for field in twin.get_fields_and_field_types():
        value = getattr(generated(), field)
        if "Event" not in (part, field):
            assert type(getattr(twin(), field)) is type(value), field


def classes_of(name: str) -> Iterator[Any]:
    """List the class of an interface and those of its parts, which have hashes of their own."""
    kind = load_interface(name)
    yield kind
    services = [kind] if "/srv/" in name else []
    if "/action/" in name:
        services = [kind.Impl.SendGoalService, kind.Impl.GetResultService]
        yield from (kind.Goal, kind.Result, kind.Feedback, kind.Impl.FeedbackMessage, *services)
    for service in services:
        yield from (service.Request, service.Response)


def test_type_hashes() -> None:
    # Not looked up:
    others = "simulation_interfaces/", "map_msgs/", "ackermann_msgs/", "ros_gz_interfaces/"
    assert {name for name in OWN if not name.startswith(others)} == {*HASHES}
    for name, expected in HASHES.items():
        assert described(load_interface(name))["hash"][:32] == expected, name


@pytest.mark.parametrize("name", OWN)
def test_damaged_messages_are_refused(name: str) -> None:
    @settings(max_examples=3, suppress_health_check=list(HealthCheck), deadline=None)
    @given(st.data())
    def any_damage(data: st.DataObject) -> None:
        for kind in classes_of(name):
            if not hasattr(kind, "SLOT_TYPES"):
                continue
            good = bytes(serialize_message(data.draw(messages(kind))))
            for length in range(4, len(good), len(good) // 100 + 1):
                with pytest.raises(rclpy._rclpy_pybind11.RMWError):
                    deserialize_message(good[:length], kind)
            for _ in range(30):
                with suppress(rclpy._rclpy_pybind11.RMWError):
                    deserialize_message(good[:4] + broken(data.draw, good[4:]), kind)

    any_damage()


def test_values_that_do_not_fit() -> None:
    tolerance = load_interface("control_msgs/msg/JointTolerance")
    with pytest.raises(TypeError, match="JointTolerance: required argument is not a float"):
        serialize_message(tolerance(position="far"))


def test_an_unknown_interface() -> None:
    with pytest.raises(OneBotError, match="no_such_msgs/msg/Thing cannot be used: No module"):
        load_interface("no_such_msgs/msg/Thing")


# ---- On DDS ----


@pytest.fixture
def node(ros_domain: int) -> Iterator[Any]:
    with node_here("test_interfaces") as node:
        yield node


def test_a_twin_serves_the_generated_client(apart: None, node: Any, ros_domain: int) -> None:
    def answer(request: Any, response: Any) -> Any:
        response.success, response.message = request.data, f"got {request.data}"
        return response

    client = node.create_client(SetBool, "set")
    with Peer(ros_domain) as server:
        server.node.create_service(make_interface("std_srvs/srv/SetBool"), "set", answer)
        spin_until(node, client.service_is_ready, "the service")
        for value in (True, False):
            future = client.call_async(SetBool.Request(data=value))
            spin_until(node, future.done, "the answer")
            assert future.result() == SetBool.Response(success=value, message=f"got {value}")


def test_a_service_is_described() -> None:
    name = "simulation_interfaces/srv/StepSimulation"
    found = type_support._facts(load_interface(name)).sources.contents
    sources = {source.type_name.data.decode(): source for source in found.data[: found.size]}
    own, request = sources[name], sources[f"{name}_Request"]
    assert own.encoding.data == b"srv" and request.encoding.data == b"implicit"
    assert own.contents.data == b"uint64 steps 1\n---\nResult result"


def test_introspection_of_a_service_is_refused(node: Any) -> None:
    """Rather than a crash: it needs what only generated code has."""
    kind = load_interface("simulation_interfaces/srv/StepSimulation")
    service = node.create_service(kind, "step", lambda request, response: response)
    client = node.create_client(kind, "step")
    qos = rclpy.qos.qos_profile_system_default
    with pytest.raises(rclpy._rclpy_pybind11.RCLError):
        service.configure_introspection(node.get_clock(), qos, ServiceIntrospectionState.CONTENTS)
        spin_until(node, client.service_is_ready, "the service")
        future = client.call_async(kind.Request(steps=3))
        spin_until(node, future.done, "the answer")
