"""Names of the ROS graph."""


def absolute(namespace: str) -> str:
    """Return a namespace with a slash at its start and none at its end; "" for the root.

    The full name of a node in it is ``f"{absolute(namespace)}/{name}"``.
    """
    return f"/{namespace.strip('/')}".rstrip("/")
