"""``onebot topic ...``: look at topics and publish on them, as ``ros2 topic`` does."""

from collections.abc import Sequence

from onebot_bringup.cli.subcommands import Subcommand, dispatch

_HERE = "onebot_bringup.cli"
COMMANDS = {
    "pub": Subcommand("publish messages", f"{_HERE}.topic_pub:pub"),
    "echo": Subcommand("print messages as they come", f"{_HERE}.topic_echo:echo"),
    "list": Subcommand("list the topics", f"{_HERE}.topic_list:topics"),
    "info": Subcommand("show who publishes and who listens", f"{_HERE}.topic_list:info"),
    "type": Subcommand("show a topic's type", f"{_HERE}.topic_list:type_of"),
    "find": Subcommand("list the topics of a type", f"{_HERE}.topic_list:find"),
    "hz": Subcommand("measure how often messages come", f"{_HERE}.topic_hz:hz"),
    "bw": Subcommand("measure how many bytes a second come", f"{_HERE}.topic_hz:bw"),
    "delay": Subcommand("measure how old messages are, by their header", f"{_HERE}.topic_hz:delay"),
}


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code.

    Raises:
        OneBotError: a name or a value is wrong, or the command line is.
    """
    return dispatch("topic", COMMANDS, argv)
