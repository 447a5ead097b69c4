"""Sends a goal to an action, for a command that shows its progress; Ctrl-C cancels the goal."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from onebot_bringup.cli.session import Session
from onebot_description.errors import OneBotError

_ANSWER = 10.0  # s to wait for an answer


class GoalEnd(NamedTuple):
    """How a goal has ended."""

    succeeded: bool
    canceled: bool
    interrupted: bool  # Ctrl-C was pressed
    result: Any


class Action:
    """The client of an action."""

    def __init__(
        self, session: Session, kind: str, name: str, *, unanswered: str, missing: str = ""
    ) -> None:
        """Discover the action.

        Args:
            session: the command's.
            kind: type of the action.
            name: its full name.
            unanswered: the error if its server does not answer.
            missing: added to the error if there is no such action.

        Raises:
            OneBotError: there is no such action.
        """
        from rclpy.action import ActionClient

        from onebot_description.ros.wire.interfaces import load_interface

        self.type = load_interface(kind)
        self._session, self._unanswered = session, unanswered
        self._client = ActionClient(session.node, self.type, name)
        if not session.look_for(self._client.server_is_ready, f"the action {name}"):
            raise OneBotError(f"there is no action {name}{missing}")

    @contextmanager
    def executed(
        self,
        goal: Any,
        show_until: Callable[[Callable[[], bool]], None],
        on_feedback: Callable[[Any], None] | None = None,
    ) -> Iterator[GoalEnd | None]:
        """Send a goal and wait for its end; Ctrl-C cancels it, and ends the ``with`` block.

        Args:
            goal: the goal.
            show_until: shows the progress until the function passed to it returns true.
            on_feedback: called with each feedback message.

        Yields:
            How it has ended; None if it was rejected.

        Raises:
            OneBotError: the action's server does not answer.
        """
        from onebot_description.ros.wire.interfaces import load_interface

        statuses = load_interface("action_msgs/msg/GoalStatus")
        with self._session.interrupts.deferred() as interrupted:
            handle = self._answer(self._client.send_goal_async(goal, on_feedback))
            if not handle.accepted:
                yield None
                return
            ended = handle.get_result_async()
            try:
                show_until(lambda: ended.done() or interrupted() or self._is_gone())
            finally:  # the terminal may be closed
                if not ended.done():
                    self._answer(handle.cancel_goal_async())
            end = self._answer(ended)
            succeeded = end.status == statuses.STATUS_SUCCEEDED
            canceled = end.status == statuses.STATUS_CANCELED
            yield GoalEnd(succeeded, canceled, interrupted(), end.result)

    def _is_gone(self) -> bool:
        return not self._client.server_is_ready()

    def _answer(self, future: Any) -> Any:
        """Wait for an answer, and return it."""
        self._session.spin(lambda: future.done() or self._is_gone(), _ANSWER)
        if not future.done():
            raise OneBotError(self._unanswered)
        return future.result()
