"""Classes made of a definition: the same as generated ones, for rclpy and on the wire.

Every installed message and service has a twin here, made of its definition: the two are compared.
"""

import array
import copy
import importlib
import json
import pickle
import sys
from collections import UserList
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nav2_msgs.msg import Costmap
from nav_msgs.msg import OccupancyGrid
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.service_introspection import ServiceIntrospectionState
from rosidl_adapter import convert_to_idl
from rosidl_generator_type_description import generate_type_hash
from std_srvs.srv import SetBool

from onebot_description.errors import OneBotError
from onebot_description.ros.wire import message_class, type_support
from onebot_description.ros.wire.interface_text import (
    definitions,
    installed_interfaces,
    own_interfaces,
    own_packages,
)
from onebot_description.ros.wire.interfaces import load_interface, make_interface
from tests.any_message import broken, messages
from tests.ros_support import Peer, node_here, spin_until

OWN = [name for kind in ("msg", "srv", "action") for name in own_interfaces(kind)]
GENERATED = [
    name for kind in ("msg", "srv") for name in installed_interfaces(kind) if name not in OWN
]

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

    @settings(max_examples=2, suppress_health_check=list(HealthCheck))
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
    assert twin() == twin() != generated() and twin.__hash__ is None
    names = [key for key in dir(generated) if key.isupper()]
    for key in set(names) - {"SLOT_TYPES"}:
        assert getattr(twin, key) == getattr(generated, key), key
    for key in set(names) - {"SLOT_TYPES"}:
        with pytest.raises(AttributeError):
            setattr(twin, key, 0)
    for field in twin.get_fields_and_field_types():
        assert problems(twin, field) == problems(generated, field)
        value = getattr(generated(), field)
        if "Event" not in (part, field):
            assert type(getattr(twin(), field)) is type(value), field


@pytest.mark.slow
def test_hashes_of_ros(tmp_path: Path) -> None:
    """Every type has the description and hash that ROS's own generator gives its definition."""
    include_paths = [f"{share.name}:{share}" for share in Path(sys.prefix, "share").iterdir()]
    packages = own_packages()
    # The last two need others.
    for package in sorted(packages, key=lambda name: name in ("moveit_msgs", "nav2_msgs")):
        files = [file.relative_to(packages[package]) for file in definitions(packages[package])]
        for file in files:
            convert_to_idl(packages[package], package, file, tmp_path / package)
        idl_files = [f"{tmp_path / package}:{file.with_suffix('.idl')}" for file in files]
        arguments = {
            "package_name": package,
            "output_dir": str(tmp_path / package),
            "idl_tuples": idl_files,
            "include_paths": include_paths,
        }
        (tmp_path / "arguments.json").write_text(json.dumps(arguments))
        generate_type_hash(str(tmp_path / "arguments.json"))
        include_paths.append(f"{package}:{tmp_path / package}")
    for name in OWN:
        assert described(load_interface(name)) == generated_description(name, tmp_path), name


VALUES = (
    *(None, "x", 300 * "x", -1, 200, 40_000, 2**40, 2**70, 1.5, 1e39, float("inf"), True, {1: 2}),
    *(b"", b"a", b"ab", [], [1], [300], [2**70], [1.5], 3 * [1.5], 9 * [0.0], 36 * [0.0], {1.5}),
    *(["x"], [None], [b"a"], [b""], [True], np.zeros(3), np.zeros(9), np.zeros(3, "f"), "abc"),
    *(array.array("d", [1.0]), array.array("f"), array.array("B", [1]), UserList([1.5])),
)


def problems(kind: Any, field: str) -> list[str]:
    """Return the error of each value of one of a checked message's fields."""
    message, found = kind(check_fields=True), []
    for value in VALUES:
        try:
            setattr(message, field, value)
            found.append("")
        except Exception as error:
            found.append(type(error).__name__)
    return found


def test_unknown_arguments() -> None:
    for kind in (Costmap, OccupancyGrid):
        assert kind(no_field=1) == kind()
        with pytest.raises(AssertionError, match="passed to constructor: a, no_field"):
            kind(no_field=1, a=2, check_fields=True)


@pytest.mark.parametrize("name", OWN)
def test_copies(name: str) -> None:
    """Each class and each part is found where it says it is, by copy and by pickle."""
    for kind in classes_of(name):
        assert getattr(importlib.import_module(kind.__module__), kind.__name__) is kind
        if hasattr(kind, "SLOT_TYPES"):
            message = kind()
            assert copy.copy(message) == copy.deepcopy(message) == message
            assert pickle.loads(pickle.dumps(message)) == message
            assert type(pickle.loads(pickle.dumps(message))) is kind
        else:
            with pytest.raises(NotImplementedError, match="can not be instantiated"):
                kind()


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
    for name, expected in HASHES.items():
        assert described(load_interface(name))["hash"][:32] == expected, name


@pytest.mark.parametrize(
    "name",
    [
        "control_msgs/action/FollowJointTrajectory",
        "control_msgs/msg/JointTrajectoryControllerState",
        "control_msgs/srv/QueryTrajectoryState",
        "nav2_msgs/msg/Costmap",
        "vision_msgs/msg/Detection2D",
    ],
)
def test_damaged_messages_are_refused(name: str) -> None:
    @settings(max_examples=2, suppress_health_check=list(HealthCheck))
    @given(st.data())
    def any_damage(data: st.DataObject) -> None:
        for kind in classes_of(name):
            if not hasattr(kind, "SLOT_TYPES"):
                continue
            good = bytes(serialize_message(data.draw(messages(kind))))
            for length in range(4, len(good), len(good) // 20 + 1):
                with pytest.raises(rclpy._rclpy_pybind11.RMWError):
                    deserialize_message(good[:length], kind)
            for _ in range(8):
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
