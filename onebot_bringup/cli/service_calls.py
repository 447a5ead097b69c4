"""One call of a service, with an end to the waiting."""

from typing import Any

from onebot_bringup.cli.ros_session import Session
from onebot_description.errors import OneBotError

_ANSWER = 10.0  # s


def call(session: Session, kind: Any, name: str, request: Any, timeout: float = _ANSWER) -> Any:
    """Call a service and return its response.

    Args:
        session: whose node asks.
        kind: the class of the service.
        name: its full name.
        request: what to ask.
        timeout: seconds for finding the service, and again for its answer.

    Raises:
        OneBotError: it is not there, or does not answer.
    """
    client = session.node.create_client(kind, name)
    try:
        if not session.spin(client.service_is_ready, timeout):
            raise OneBotError(f"the service {name} is not available")
        future = client.call_async(request)
        if not session.spin(future.done, timeout):
            raise OneBotError(f"the service {name} does not answer (waited {timeout:g} s)")
        return future.result()
    finally:
        session.node.destroy_client(client)
