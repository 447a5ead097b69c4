"""Provides classes of messages, services and actions, whether or not their package is installed.

    load_interface("control_msgs/action/FollowJointTrajectory")

returns the class of an installed package, or else a class made from a definition. Both are the same
on the wire (the type's name, hash and description, and every field), so nodes that use the genuine
package interoperate.

rclpy loads the type support with the first publisher, subscription, service, client or conversion.
If that fails, it raises a ``OneBotError`` that is also an ``ImportError``.
"""

import contextlib
import functools
import importlib
import io
import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from rosidl_adapter import parser
from rosidl_parser.definition import (
    AbstractType,
    Action,
    Array,
    BasicType,
    BoundedSequence,
    BoundedString,
    BoundedWString,
    Message,
    NamespacedType,
    Service,
    Structure,
    UnboundedSequence,
    UnboundedString,
    UnboundedWString,
)

from onebot_description.errors import OneBotError
from onebot_description.ros.wire import type_support
from onebot_description.ros.wire.interface_text import (
    interface_file,
    interface_text,
    own_file,
)
from onebot_description.ros.wire.message_class import (
    MessageField,
    full_name,
    keep_class,
    made_class,
    make_message_class,
    make_metaclass,
    module_name,
)
from onebot_description.ros.wire.type_description import Definition
from onebot_description.ros.wire.type_support import TypeSupportError

_IDL_NAMES = {  # IDL names of the types in .msg files
    "bool": "boolean",
    "byte": "octet",
    "char": "uint8",
    "float32": "float",
    "float64": "double",
}


_BEING_MADE: set[str] = set()
_LOCK = threading.RLock()  # a class is made once, whichever threads use it first


class InterfaceError(OneBotError, ImportError):
    """A definition cannot be used; ``str(error)`` names its file and line."""


@functools.cache
def load_interface(name: str) -> Any:
    """Return the class of an interface by its full name, such as ``std_srvs/srv/Trigger``.

    Raises:
        OneBotError: there is none.
    """
    package, kind, short = name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.{kind}"), short)
    except (ImportError, AttributeError) as error:
        if not own_file(name):
            raise OneBotError(f"{name} cannot be used: {error}") from error
    return own_interface(name)


def own_interface(name: str) -> Any:
    """Return the class of an interface of a package that is made from definitions.

    Raises:
        InterfaceError: its definition cannot be used.
    """
    with _LOCK:
        if made := made_class(name):
            return made
        if name in _BEING_MADE:
            raise InterfaceError(f"{name} contains itself")
        _BEING_MADE.add(name)
        try:
            return make_interface(name)
        finally:
            _BEING_MADE.remove(name)


def make_interface(name: str) -> Any:
    """Return a class made from the definition, whether or not the package is installed."""
    package, kind, short = name.split("/")
    text = interface_text(name)
    make = {"msg": _message, "srv": _service, "action": _action}[kind]
    try:
        with contextlib.redirect_stderr(io.StringIO()):  # the parser also prints
            return make(package, short, text)
    except TypeSupportError:
        raise
    except Exception as error:  # the parser raises many types
        raise _explained(error, name, text) from None


def _explained(error: Exception, name: str, text: str) -> InterfaceError:
    """Return the error with the file and the line: the first line up to which parsing fails."""
    package, kind, short = name.split("/")
    start, lines = 0, text.splitlines()
    for number, line in enumerate(lines):
        if line.strip() == "---":
            start = number + 1
        try:
            part = "\n".join(lines[start : number + 1])
            with contextlib.redirect_stderr(io.StringIO()):
                _parsed(package, kind, short, parser.parse_message_string(package, short, part))
        except Exception as found:
            where = f'{interface_file(name)}, line {number + 1}: "{line.strip()}"'
            return InterfaceError(f"{where} cannot be used: {_reason(found)}")
    return InterfaceError(f"{interface_file(name)} cannot be used: {_reason(error)}")


def _reason(error: Exception) -> str:
    if isinstance(error, parser.InvalidFieldDefinition):
        return "it is neither a field, such as `float64[3] point`, nor a constant"
    return str(error) or type(error).__name__


# ---- Messages ----


def _message(package: str, short: str, text: str) -> Any:
    specification = parser.parse_message_string(package, short, text)
    return _make_message(_parsed(package, "msg", short, specification), "msg", text)


def _parsed(package: str, kind: str, short: str, specification: Any) -> Message:
    """Return a parsed definition as rosidl's type; create the classes of the messages in it."""
    members = [
        MessageField(field.name, _slot(field.type), field.default_value)
        for field in specification.fields
    ]
    message = Message(Structure(NamespacedType([package, kind], short), members))
    message.constants = specification.constants
    return message


def _make_message(message: Message, encoding: str = "implicit", text: str = "") -> Any:
    """Return a message class; ``text`` and ``encoding`` describe the file that defines it."""
    name = full_name(message.structure.namespaced_type)
    fields = [
        MessageField(member.name, member.type, getattr(member, "default", None))
        for member in message.structure.members
    ]
    described = Definition(name, fields or [type_support.EMPTY], encoding, text.rstrip("\n"))
    load = functools.partial(type_support.support_message, definition=described)
    values = {
        constant.name: bytes([constant.value]) if constant.type == "byte" else constant.value
        for constant in message.constants
    }
    return make_message_class(name, fields, values, load)


def _slot(kind: Any) -> AbstractType:
    """Return a parsed type as in generated classes."""
    item = _item(kind)
    if not kind.is_array:
        return item
    if not kind.array_size:
        return UnboundedSequence(item)
    return (BoundedSequence if kind.is_upper_bound else Array)(item, kind.array_size)


def _item(kind: Any) -> AbstractType:
    if kind.pkg_name:
        load_interface(f"{kind.pkg_name}/msg/{kind.type}")
        return NamespacedType([kind.pkg_name, "msg"], kind.type)
    if kind.type == "string":
        bound = kind.string_upper_bound
        return BoundedString(bound) if bound else UnboundedString()
    if kind.type == "wstring":
        bound = kind.string_upper_bound
        return BoundedWString(bound) if bound else UnboundedWString()
    return BasicType(_IDL_NAMES.get(kind.type, kind.type))


# ---- Services ----


def _service(package: str, short: str, text: str) -> Any:
    specification = parser.parse_service_string(package, short, text)
    service = Service(
        NamespacedType([package, "srv"], short),
        _parsed(package, "srv", f"{short}_Request", specification.request),
        _parsed(package, "srv", f"{short}_Response", specification.response),
    )
    return _make_service(service, "srv", text)


def _make_service(service: Service, encoding: str = "implicit", text: str = "") -> Any:
    """Return a service class; ``text`` and ``encoding`` describe the file that defines it."""
    messages = {
        "Request": service.request_message,
        "Response": service.response_message,
        "Event": service.event_message,
    }
    members = [
        MessageField(f"{part.lower()}_message", message.structure.namespaced_type)
        for part, message in messages.items()
    ]
    parts = {part: _make_message(message) for part, message in messages.items()}
    name = full_name(service.namespaced_type)
    described = Definition(name, members, encoding, text.rstrip("\n"))
    return _make_class(described, parts, type_support.support_service)


def _make_class(definition: Definition, parts: dict[str, Any], support: Callable[..., None]) -> Any:
    """Return the class of a service or an action, which only holds its parts."""
    name = definition.name.rpartition("/")[2]
    load = functools.partial(support, definition=definition)
    kind = "Service" if support is type_support.support_service else "Action"

    def refuse(self: Any) -> None:
        raise NotImplementedError(f"{kind} classes can not be instantiated")

    message_class = make_metaclass(name, load)(
        name, (), {"__module__": module_name(definition.name), "__init__": refuse, **parts}
    )
    return keep_class(definition.name, message_class)


# ---- Actions ----


def _action(package: str, short: str, text: str) -> Any:
    """Return an action class, with the services and the topic that ROS derives from it."""
    specification = parser.parse_action_string(package, short, text)
    halves = {
        "Goal": specification.goal,
        "Result": specification.result,
        "Feedback": specification.feedback,
    }
    messages = {
        part: _parsed(package, "action", f"{short}_{part}", half) for part, half in halves.items()
    }
    parts = {part: _make_message(message) for part, message in messages.items()}
    action = Action(NamespacedType([package, "action"], short), *messages.values())
    implementation = {
        "SendGoalService": _make_service(action.send_goal_service),
        "GetResultService": _make_service(action.get_result_service),
        "FeedbackMessage": _make_message(action.feedback_message),
        "CancelGoalService": load_interface("action_msgs/srv/CancelGoal"),
        "GoalStatusMessage": load_interface("action_msgs/msg/GoalStatusArray"),
    }
    slots = {
        "goal": action.goal.structure,
        "result": action.result.structure,
        "feedback": action.feedback.structure,
        "send_goal_service": action.send_goal_service,
        "get_result_service": action.get_result_service,
        "feedback_message": action.feedback_message.structure,
    }
    members = [MessageField(member, part.namespaced_type) for member, part in slots.items()]
    name = full_name(action.namespaced_type)
    described = Definition(name, members, "action", text.rstrip("\n"))
    parts["Impl"] = type("Impl", (), implementation)
    return _make_class(described, parts, type_support.support_action)


if TYPE_CHECKING:

    class TFMessage:
        """A tf2_msgs/msg/TFMessage: coordinate transforms, as on the topics /tf and /tf_static."""

        transforms: Sequence[Any]

        def __init__(self, *, transforms: Sequence[Any] = ()) -> None: ...
else:
    TFMessage = load_interface("tf2_msgs/msg/TFMessage")
