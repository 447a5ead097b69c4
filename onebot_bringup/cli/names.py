"""Names and types of topics and services, and the command that lists either."""

import json
from argparse import Namespace
from collections.abc import Callable
from dataclasses import dataclass

from onebot_bringup.cli.options import Subcommand, flag
from onebot_bringup.cli.session import Session, in_session
from onebot_description.errors import OneBotError, alike, did_you_mean


@dataclass(frozen=True)
class Named:
    """The names of topics, or of services."""

    word: str  # "topic" or "service"
    # Returns names and types; with True, including hidden ones.
    discovered: Callable[[Session, bool], list[tuple[str, list[str]]]]

    def types(self, session: Session, name: str) -> list[str]:
        """Return the types with which a full name has been discovered."""
        return dict(self.discovered(session, True)).get(name, [])

    def find_types(self, session: Session, name: str) -> tuple[str, list[str]]:
        """Return the full name and the types of an existing topic or service.

        Raises:
            OneBotError: it was not discovered; the message lists similar names.
        """
        full = session.full_name(name)
        types = session.look_for(lambda: self.types(session, full), f"the {self.word} {full}")
        if not types:
            names = [name for name, _ in self.discovered(session, False)]
            hint = did_you_mean(full, names, f"{self.word}s")
            raise OneBotError(f"Unknown {self.word} '{full}'{hint}")
        return full, types

    def question(self, session: Session, name: str) -> str:
        """Return a question about similar names, such as `` (did you mean "/a"?)``; "" for none."""
        names = alike(name, [candidate for candidate, _ in self.discovered(session, False)])
        return f" (did you mean {' or '.join(map(json.dumps, names))}?)" if names else ""

    def print_names(self, session: Session, args: Namespace) -> None:
        """List the names, with their types if requested."""
        session.discover()
        for name, types in self.discovered(session, args.hidden):
            print(f"{name} [{', '.join(types)}]" if args.show_types else name)

    def listing(self) -> Subcommand:
        """Return the command that lists the names."""
        word = self.word
        return Subcommand(
            f"list the {word}s",
            in_session(self.print_names),
            flag("-t --show-types", "show the types too"),
            flag(f"-a --all --include-hidden-{word}s", f"hidden {word}s too", dest="hidden"),
        )


TOPICS = Named("topic", Session.topics)
SERVICES = Named("service", Session.services)
