"""Classes made of a definition: the same as generated ones, for rclpy and on the wire.

Every installed message and service has a twin here, made of its definition: the two are compared.
"""

import json
import random
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
from type_description_interfaces.srv import GetTypeDescription

from onebot_bringup.introspection.interfaces import installed
from onebot_description.errors import OneBotError
from onebot_description.ros.wire import message_class, type_support
from onebot_description.ros.wire.interface_text import own_interfaces
from onebot_description.ros.wire.interfaces import load_interface, make_interface
from tests.any_message import messages
from tests.ros_support import Peer, node_here, spin_until

OWN = [name for kind in ("msg", "srv", "action") for name in own_interfaces(kind)]
GENERATED = [name for kind in ("msg", "srv") for name in installed(kind) if name not in OWN]

# The first half of type hashes of the control_msgs of ROS 2 Jazzy (5.8.0), by its own generator.
# Those of an action or a service are of its messages, too: they are parts of its description.
CONTROL_MSGS = {
    "action/FollowJointTrajectory": "738ebcb7a2d7cfa42f9f1001cc99ce3a",
    "action/ParallelGripperCommand": "adfd3c1ebe8abc38ebcc0e454b6423d2",
    "msg/JointComponentTolerance": "739ea7566931944d33830fa10f1bf5e7",
    "msg/JointTolerance": "c254f9cece0f3b733017b6990fd46d13",
    "msg/JointTrajectoryControllerState": "51d8dd89cc624cbe9daaeeb4d80d6de9",
    "msg/SpeedScalingFactor": "0c240f349f2b74e33e8741f83e0f196d",
    "srv/QueryTrajectoryState": "4a0935dffef18bc5b9e101c9d03d84e6",
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
    assert list(twin.__slots__) == list(generated.__slots__)
    assert repr(twin()) == repr(generated())
    constants = {key for key in dir(generated) if key.isupper() and key != "SLOT_TYPES"}
    for key in constants:
        assert getattr(twin, key) == getattr(generated, key), key
    for field in twin.get_fields_and_field_types():
        value = getattr(generated(), field)
        if "Event" not in (part, field):
            assert type(getattr(twin(), field)) is type(value), field
    with pytest.raises(AssertionError, match="Invalid arguments passed to constructor: wrong"):
        twin(wrong=1, check_fields=True)


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


def test_type_hashes_of_control_msgs() -> None:
    found = {name for name in OWN if name.startswith("control_msgs/")}
    assert found == {f"control_msgs/{name}" for name in CONTROL_MSGS}
    for name, expected in CONTROL_MSGS.items():
        assert described(load_interface(f"control_msgs/{name}"))["hash"][:32] == expected, name


@pytest.mark.parametrize("name", OWN)
def test_damaged_messages_are_refused(name: str) -> None:
    dice = random.Random(name)
    for kind in classes_of(name):
        if not hasattr(kind, "SLOT_TYPES"):
            continue
        good = bytes(serialize_message(filled(kind)))
        for length in range(4, len(good)):
            with pytest.raises(rclpy._rclpy_pybind11.RMWError):
                deserialize_message(good[:length], kind)
        for _ in range(100):
            data = bytearray(good)
            for _ in range(dice.randint(1, 6)):
                data[dice.randrange(4, len(data))] = dice.randrange(256)
            with suppress(rclpy._rclpy_pybind11.RMWError):
                deserialize_message(bytes(data), kind)


def filled(kind: Any) -> Any:
    """Return a message with something in each list and string."""
    message = kind()
    for name, slot in zip(kind.get_fields_and_field_types(), kind.SLOT_TYPES, strict=True):
        value = getattr(message, name)
        if isinstance(value, str):
            setattr(message, name, "some text")
        elif hasattr(value, "get_fields_and_field_types"):
            setattr(message, name, filled(type(value)))
        elif isinstance(slot, message_class.AbstractNestedType) and not len(value):
            item = slot.value_type
            if isinstance(item, message_class.NamespacedType):
                setattr(message, name, [filled(message_class.class_of(item))])
            else:
                is_text = isinstance(item, message_class.AbstractGenericString)
                setattr(message, name, ["a"] if is_text else [1])
    return message


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


def test_a_service_is_described(node: Any) -> None:
    """By ``~/get_type_description``, which ros2 type_description_interfaces has."""
    kind = load_interface("simulation_interfaces/srv/StepSimulation")
    node.create_service(kind, "step", lambda request, response: response)
    client = node.create_client(GetTypeDescription, "~/get_type_description")
    spin_until(node, client.service_is_ready, "the node's own service")
    expected = described(kind)
    request = GetTypeDescription.Request(
        type_name="simulation_interfaces/srv/StepSimulation",
        type_hash=f"RIHS01_{expected['hash']}",
        include_type_sources=True,
    )
    future = client.call_async(request)
    spin_until(node, future.done, "the description")
    response = future.result()
    assert response.successful, response.failure_reason
    sources = {source.type_name: source for source in response.type_sources}
    own = sources["simulation_interfaces/srv/StepSimulation"]
    assert (own.encoding, own.raw_file_contents) == (
        "srv",
        "uint64 steps 1\n---\nResult result",
    )
    assert sources["simulation_interfaces/srv/StepSimulation_Request"].encoding == "implicit"


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
