"""The view on show: from a file that is edited, from parameters, or the robot's own."""

from collections.abc import Callable
from pathlib import Path

from onebot_bringup.rerun_topics import DriveTopics
from onebot_bringup.rerun_view_parameters import ViewParameters
from onebot_bringup.viewer.live_view import LiveView
from onebot_bringup.viewer.view_source import ViewSource
from onebot_description.errors import OneBotError


class ShownView:
    """Shows what the user has changed; a mistake is said once, and changes nothing."""

    def __init__(
        self,
        source: ViewSource,
        settings: ViewParameters,
        live: LiveView,
        topics: DriveTopics,
        say: Callable[[str], object],
        warn: Callable[[str], object],
    ) -> None:
        """Begin with what is on show.

        Args:
            source: the view.
            settings: the parameters that say the same.
            live: shows it.
            topics: heard for it.
            say: is told what is shown now.
            warn: is told what cannot be shown.
        """
        self._source, self._settings = source, settings
        self._live, self._topics = live, topics
        self._say, self._warn = say, warn
        self._refused: set[Path] = set()  # files with a mistake

    def watch(self) -> None:
        """Take up what was edited; call it now and then."""
        for file in self._source.saved():
            mended = file in self._refused
            self._refused.discard(file)
            try:
                if file == self._source.layout:
                    self._live.use_blueprint(file)
                elif self._source.reload():
                    self._settings.mirror()
                    self.show()
                    self._say(f"{file} was edited: the view is up to date")
                    mended = False  # said already
                if mended:
                    self._say(f"{file} is right again: it is in use")
            except OneBotError as error:
                self._refused.add(file)
                self._warn(f"keeping the view shown so far: {error}")

    def take_view_of(self, robot: str) -> None:
        """Look at the robot as its own description says, if the user asks for no other view."""
        try:
            if self._source.set_robot(robot):
                self._settings.mirror()
                self.show()
                self._say(f"its view is {self._source.file or 'the usual one'}")
        except OneBotError as error:
            self._warn(f"keeping the view shown so far: {error}")

    def show(self) -> None:
        """Show what the view says now."""
        view = self._source.view
        for problem in self._live.set_view(view):
            self._warn(problem)
        try:
            self._topics.set_view(view)
        except OneBotError as error:
            self._warn(str(error))
