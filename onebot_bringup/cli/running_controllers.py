"""Finds the running joint_trajectory_controllers, and the one that a command means."""

from collections.abc import Callable, Sequence
from typing import Any

from onebot_bringup.cli.session import Session
from onebot_description.errors import OneBotError, did_you_mean, listing, unknown_names

_STATE = "control_msgs/msg/JointTrajectoryControllerState"
_TOPIC = "/controller_state"
_DEPTH = 1000  # states; several seconds of a busy computer
_START = "start one with mrm_bringup sim:=true, or for any robot onebot view FILE sim:=true"


class RunningController:
    """A joint_trajectory_controller, with the latest message of its ~/controller_state.

    Attributes:
        name: the full name of its node.
        state: the message; None until one is received.
        on_state: called with each message.
    """

    on_state: Callable[[Any], object] = staticmethod(lambda state: None)

    def __init__(self, session: Session, name: str) -> None:
        from onebot_description.ros.topic_qos import compatible_qos
        from onebot_description.ros.wire.interfaces import load_interface

        self.name = name
        self.state: Any = None
        node, topic = session.node, name + _TOPIC
        offered = [info.qos_profile for info in node.get_publishers_info_by_topic(topic)]
        qos = compatible_qos(offered, depth=_DEPTH)
        node.create_subscription(load_interface(_STATE), topic, self._receive, qos)

    def _receive(self, state: Any) -> None:
        self.state = state
        self.on_state(state)

    @property
    def joints(self) -> list[str]:
        """The names of its joints, in the controller's order."""
        return list(self.state.joint_names)


def running_controllers(session: Session, name: str = "") -> list[RunningController]:
    """Return the controllers that run in the session's namespace and below, each with a state.

    Args:
        session: the session that discovers them.
        name: the name of the only controller wanted; "" for all.

    Raises:
        OneBotError: there is none, or none publishes its state.
    """
    full_name = session.full_name(name) if name else ""

    def found() -> list[str]:
        return [name for name in _names(session) if full_name in ("", name)]

    if not session.look_for(found, full_name or "a joint_trajectory_controller"):
        hint = did_you_mean(full_name, _names(session), "controllers") if full_name else ""
        what = full_name or "joint_trajectory_controller"
        raise OneBotError(f"no {what} found{hint}; {_START}")
    if not full_name:
        session.discover()  # there may be more than the first one found
    controllers = [RunningController(session, name) for name in found()]
    session.look_for(
        lambda: all(controller.state for controller in controllers),
        " and ".join(controller.name + _TOPIC for controller in controllers),
    )
    if active := [controller for controller in controllers if controller.state]:
        return active
    names = listing(controller.name for controller in controllers)
    raise OneBotError(f"no ~/controller_state of {names}: it is inactive, or its time is paused")


def _names(session: Session) -> list[str]:
    topics = session.published(_STATE, _TOPIC, session.space)
    return [topic.removesuffix(_TOPIC) for topic in topics]


def controller_of(
    controllers: Sequence[RunningController], joints: Sequence[str]
) -> RunningController:
    """Return the controller that moves all of these joints.

    Raises:
        OneBotError: none does, or several do; the message lists them with their joints.
    """
    known_joints = {joint for controller in controllers for joint in controller.joints}
    if unknown := [*unknown_names(joints, known_joints, "joints")]:
        raise OneBotError("\n".join(f'no joint "{name}"{hint}' for name, hint in unknown))
    suited = [item for item in controllers if set(joints) <= {*item.joints}]
    if len(suited) == 1:
        return suited[0]
    text = "; ".join(f"{item.name} moves {listing(item.joints)}" for item in controllers)
    count = "several controllers move" if suited else "no controller moves"
    raise OneBotError(f"{count} all of these joints, choose one by controller:=NAME: {text}")
