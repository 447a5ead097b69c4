"""The commands that exist for both topics and services: list, type and find."""

import json
from argparse import Namespace
from collections.abc import Callable
from dataclasses import dataclass

from onebot_bringup.cli.options import Subcommand, flag, positional, print_rows
from onebot_bringup.cli.session import SPIN_TIME, Session, in_session
from onebot_description.errors import OneBotError, alike, did_you_mean


@dataclass(frozen=True)
class Named:
    """The commands of topics, or of services."""

    word: str  # "topic" or "service"
    interface: str  # the kind of their types, "msg" or "srv"
    example: str  # an example of a type
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
        types = session.look_for(
            lambda: self.types(session, full),
            f"the {self.word} {full}",
            lambda: self.question(session, full),
        )
        if not types:
            names = [name for name, _ in self.discovered(session, False)]
            hint = did_you_mean(full, names, f"{self.word}s")
            raise OneBotError(f"Unknown {self.word} '{full}'{hint}")
        return full, types

    def question(self, session: Session, name: str) -> str:
        """Return a question about similar names, such as ``did you mean "/a"?``; "" for none."""
        names = alike(name, [candidate for candidate, _ in self.discovered(session, False)])
        return f"did you mean {' or '.join(map(json.dumps, names))}?" if names else ""

    def print_names(self, session: Session, args: Namespace) -> None:
        """List the names, with their types if requested."""
        session.discover()
        print_rows(
            [
                f"{name} [{', '.join(types)}]" if args.show_types else name
                for name, types in self.discovered(session, args.hidden)
            ],
            count=args.count,
        )

    def print_types(self, session: Session, args: Namespace) -> None:
        """Show the types of one topic or service."""
        print("\n".join(self.find_types(session, getattr(args, self.word))[1]))

    def print_names_of_type(self, session: Session, args: Namespace) -> None:
        """List the names of one type."""
        from onebot_bringup.introspection.interfaces import full_name

        kind = full_name(args.type, self.interface)
        session.discover()
        names = [name for name, types in self.discovered(session, args.hidden) if kind in types]
        print_rows(names, count=args.count)

    def commands(self) -> dict[str, Subcommand]:
        """Return the subcommands by name."""
        word = self.word
        listing = (
            flag(f"-c --count-{word}s", "show their number only", dest="count"),
            flag(f"-a --all --include-hidden-{word}s", f"hidden {word}s too", dest="hidden"),
            SPIN_TIME,
        )
        types = flag("-t --show-types", "show the types too")
        kind = positional("TYPE", f"such as {self.example}")
        return {
            "list": Subcommand(f"list the {word}s", in_session(self.print_names), types, *listing),
            "type": Subcommand(
                f"show a {word}'s type", in_session(self.print_types), positional(word.upper())
            ),
            "find": Subcommand(
                f"list the {word}s of a type", in_session(self.print_names_of_type), kind, *listing
            ),
        }


TOPICS = Named("topic", "msg", "geometry_msgs/msg/Twist", Session.topics)
SERVICES = Named("service", "srv", "std_srvs/srv/Trigger", Session.services)
