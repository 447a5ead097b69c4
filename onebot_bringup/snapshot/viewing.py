"""The viewer of a running robot: it has the curves and trails that no newcomer can know."""

import re
from contextlib import suppress
from dataclasses import dataclass
from urllib.parse import unquote

from std_msgs.msg import String

from onebot_bringup.cli.ros_session import PATIENCE, Session
from onebot_bringup.raw_messages import BAD_MESSAGE, deserialize_message, tf_arrays
from onebot_description.errors import OneBotError
from onebot_description.qos import LATCHED
from onebot_description.tf.tf_message import TFMessage

# On this host only: whatever a page may say, nothing else is asked.
_SERVER = re.compile(r"rerun\+http://127\.0\.0\.1:\d{1,5}/proxy(?![\w/.])")


def server_of(page: str) -> str:
    """Return the address of the recording's server that a viewer's page shows; "" if there is none.

    Args:
        page: the page's address, as rerun_viewer publishes it.
    """
    found = _SERVER.search(unquote(page))
    return found.group() if found else ""


@dataclass(frozen=True)
class RunningViewer:
    """A viewer at work.

    Attributes:
        server: the address of its recording.
        stamp_ns: the time of something that is in it; 0 where nothing moves. What was before that
            is history, and has to arrive before a picture is taken.
    """

    server: str
    stamp_ns: int


def running_viewer(session: Session) -> RunningViewer:
    """Return the running viewer.

    Raises:
        OneBotError: no viewer with a page is running.
    """
    pages: list[str] = []
    stamps: list[int] = []

    def on_page(data: bytes) -> None:
        with suppress(ValueError):
            pages.append(server_of(deserialize_message(data, String).data))

    def on_tf(data: bytes) -> None:
        with suppress(*BAD_MESSAGE):  # a strange message is no reason to give up
            stamps.append(int(tf_arrays(data).stamps_ns.max(initial=0)))

    listen = session.node.create_subscription
    topic = session.full_name("rerun_viewer/page")
    listen(String, topic, on_page, LATCHED, raw=True)
    listen(TFMessage, "/tf", on_tf, 100, raw=True)
    if not session.look_for(lambda: pages and pages[-1], "the viewer"):
        raise OneBotError(
            f"no viewer's page on {topic}, and so no curves to draw; start the robot with "
            "viewer:=web, or draw a recording (save:=FILE.rrd). Without --dashboard, none is needed"
        )
    session.spin(lambda: stamps, PATIENCE)
    return RunningViewer(pages[-1], max(stamps, default=0))
