"""Names of the ROS graph."""

from typing import Any

_UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"  # rcl's name for an undiscovered node


def absolute(namespace: str) -> str:
    """Return a namespace with a leading and without a trailing slash; "" for the root.

    The full name of a node in it is ``f"{absolute(namespace)}/{name}"``.
    """
    return f"/{namespace.strip('/')}".rstrip("/")


def node_name(end: Any) -> str:
    """Return the full name of the node of a TopicEndpointInfo; "" while it is not discovered.

    A node's name is discovered later than its publishers and subscriptions.
    """
    is_known = end.node_name != _UNKNOWN_NODE
    return f"{absolute(end.node_namespace)}/{end.node_name}" if is_known else ""
