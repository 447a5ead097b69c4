"""The lifecycle services of Nav2's nodes that clients wait for; all nodes are always active."""

from collections.abc import Callable
from typing import Any

from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from onebot_description.ros.wire.interfaces import load_interface

_NODES = (
    *("amcl", "bt_navigator", "controller_server", "planner_server", "behavior_server"),
    *("smoother_server", "waypoint_follower", "velocity_smoother", "map_server"),
)
_MANAGERS = "lifecycle_manager_navigation", "lifecycle_manager_localization"


def offer_lifecycle(node: Node, is_ready: Callable[[], bool]) -> None:
    """Offer the services of Nav2's nodes, which are active once the navigator is ready.

    Requests to start, pause or shut down succeed without effect.
    """

    def get_state(_: Any, answer: Any) -> Any:
        active = is_ready()
        answer.current_state.id = (
            State.PRIMARY_STATE_ACTIVE if active else State.PRIMARY_STATE_INACTIVE
        )
        answer.current_state.label = "active" if active else "inactive"
        return answer

    def is_active(_: Any, answer: Any) -> Any:
        answer.success = is_ready()
        return answer

    def manage(_: Any, answer: Any) -> Any:
        answer.success = True
        return answer

    def set_parameters(request: Any, answer: Any) -> Any:
        for message in request.parameters:
            try:
                result = node.set_parameters_atomically([Parameter.from_parameter_msg(message)])
            except ParameterNotDeclaredException as error:
                result = SetParametersResult(reason=str(error))
            answer.results.append(result)
        return answer

    node.create_service(SetParameters, "waypoint_follower/set_parameters", set_parameters)
    kind = load_interface("nav2_msgs/srv/ManageLifecycleNodes")
    for name in _NODES:
        node.create_service(GetState, f"{name}/get_state", get_state)
    for name in _MANAGERS:
        node.create_service(kind, f"{name}/manage_nodes", manage)
        node.create_service(Trigger, f"{name}/is_active", is_active)
