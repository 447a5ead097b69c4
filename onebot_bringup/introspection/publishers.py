"""Which nodes publish a topic, by the ROS graph."""

from rclpy.node import Node

_UNKNOWN = "_NODE_NAME_UNKNOWN_"


def publishers(node: Node, topic: str) -> dict[bytes, str]:
    """Return the full names of the nodes that publish a topic, by the GIDs of their publishers.

    A node's name is discovered after its publishers; until then they are left out.

    Args:
        node: whose knowledge of the ROS graph is used.
        topic: the full name.
    """
    return {
        bytes(end.endpoint_gid): f"{end.node_namespace.rstrip('/')}/{end.node_name}"
        for end in node.get_publishers_info_by_topic(topic)
        if end.node_name != _UNKNOWN
    }
