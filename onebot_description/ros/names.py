"""Names of the ROS graph."""

import re
from typing import Any

NAMESPACE = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
"""A namespace without slashes, as that of a robot among several."""

NAMESPACE_WANTED = "letters, digits and _, not beginning with a digit"
"""What to write for one."""

_UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"  # rcl's name for one


def absolute(namespace: str) -> str:
    """Return a namespace with a slash at its start and none at its end; "" for the root.

    The full name of a node in it is ``f"{absolute(namespace)}/{name}"``.
    """
    return f"/{namespace.strip('/')}".rstrip("/")


def node_name(end: Any) -> str:
    """Return the full name of the node of a TopicEndpointInfo; "" while it is not discovered.

    A node's name is discovered later than its publishers and subscriptions.
    """
    is_known = end.node_name != _UNKNOWN_NODE
    return f"{absolute(end.node_namespace)}/{end.node_name}" if is_known else ""
