"""Sends a goal to an action, for a command that shows its progress; Ctrl-C cancels the goal."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from onebot_bringup.cli.session import Session
from onebot_description.errors import OneBotError

_ANSWER = 10.0  # s to wait for an answer


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
    def sent(
        self, goal: Any, on_feedback: Callable[[Any], None] | None = None
    ) -> Iterator["SentGoal"]:
        """Send a goal; until the end of the ``with`` block Ctrl-C only ends the wait for it.

        Raises:
            OneBotError: its server does not answer.
        """
        with self._session.interrupts.deferred() as interrupted:
            handle = self.answer(self._client.send_goal_async(goal, on_feedback))
            yield SentGoal(self, handle, interrupted)

    def is_gone(self) -> bool:
        """Return whether the action's server has ended."""
        return not self._client.server_is_ready()

    def answer(self, future: Any) -> Any:
        """Wait for an answer, and return it.

        Raises:
            OneBotError: there is none.
        """
        self._session.spin(lambda: future.done() or self.is_gone(), _ANSWER)
        if not future.done():
            raise OneBotError(self._unanswered)
        return future.result()


class SentGoal:
    """A goal that was sent.

    Attributes:
        accepted: whether it was accepted.
        interrupted: returns whether Ctrl-C was pressed since.
    """

    def __init__(self, action: Action, handle: Any, interrupted: Callable[[], bool]) -> None:
        self._action, self._handle, self.interrupted = action, handle, interrupted
        self.accepted = bool(handle.accepted)

    def result(self, show_until: Callable[[Callable[[], bool]], None]) -> Any:
        """Return the status and the result; if Ctrl-C is pressed first, the goal is cancelled.

        Args:
            show_until: shows the progress until the function passed to it returns true.

        Raises:
            OneBotError: the action's server does not answer.
        """
        ended = self._handle.get_result_async()
        try:
            show_until(lambda: ended.done() or self.interrupted() or self._action.is_gone())
        finally:  # the terminal may be closed
            if not ended.done():
                self._action.answer(self._handle.cancel_goal_async())
        return self._action.answer(ended)
