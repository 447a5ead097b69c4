"""rosbag2's metadata.yaml, version 9 (Jazzy's): what is in a recording's folder."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

FILE_NAME = "metadata.yaml"
_INFINITE = 2**63 - 1  # ns; what rosbag2 writes for an infinite duration, and for no start


@dataclass(frozen=True)
class Qos:
    """The quality of service that a publisher offers, in rosbag2's words.

    Attributes:
        reliability: ``reliable`` or ``best_effort``.
        durability: ``volatile`` or ``transient_local``.
        liveliness: ``automatic`` or ``manual_by_topic``.
        history: ``unknown``, because DDS does not tell it; or ``keep_last``, ``keep_all``.
        depth: of the history.
        deadline: nanoseconds; None for infinite.
        lifespan: nanoseconds; None for infinite.
        lease: of the liveliness, nanoseconds; None for infinite.
    """

    reliability: str = "reliable"
    durability: str = "volatile"
    liveliness: str = "automatic"
    history: str = "unknown"
    depth: int = 0
    deadline: int | None = None
    lifespan: int | None = None
    lease: int | None = None


@dataclass(frozen=True)
class Topic:
    """A topic in a recording: its name, full type name, type hash (RIHS01_...) and publishers."""

    name: str
    type: str
    hash: str = ""
    offered: tuple[Qos, ...] = ()


def qos_yaml(offered: Iterable[Qos], indent: str = "") -> str:
    """Return profiles as the YAML list that rosbag2 writes; ``[]`` of none."""
    lines = []
    for qos in offered:
        lines += [
            f"- history: {qos.history}",
            f"  depth: {qos.depth}",
            f"  reliability: {qos.reliability}",
            f"  durability: {qos.durability}",
            *_duration("deadline", qos.deadline),
            *_duration("lifespan", qos.lifespan),
            f"  liveliness: {qos.liveliness}",
            *_duration("liveliness_lease_duration", qos.lease),
            "  avoid_ros_namespace_conventions: false",
        ]
    return "\n".join(indent + line for line in lines) or f"{indent}[]"


def _duration(name: str, nanoseconds: int | None) -> list[str]:
    sec, nsec = divmod(_INFINITE if nanoseconds is None else nanoseconds, 10**9)
    return [f"  {name}:", f"    sec: {sec}", f"    nsec: {nsec}"]


@dataclass(frozen=True)
class Extent:
    """How much a recording holds: messages, and when the first and the last came (ns)."""

    count: int
    start: int
    end: int


def metadata_yaml(file: str, extent: Extent, topics: Mapping[Topic, int]) -> str:
    """Return the text of metadata.yaml for a recording of one MCAP file.

    Args:
        file: the file's name.
        extent: of all messages.
        topics: the number of messages of each.
    """
    start = extent.start if extent.count else _INFINITE
    duration = extent.end - extent.start
    name = json.dumps(file, ensure_ascii=False)  # whatever it contains
    head = f"""\
rosbag2_bagfile_information:
  version: 9
  storage_identifier: mcap
  duration:
    nanoseconds: {duration}
  starting_time:
    nanoseconds_since_epoch: {start}
  message_count: {extent.count}
  topics_with_message_count:"""
    body = "".join(_topic_yaml(topic, count) for topic, count in topics.items())
    tail = f"""\
  compression_format: ""
  compression_mode: ""
  relative_file_paths:
    - {name}
  files:
    - path: {name}
      starting_time:
        nanoseconds_since_epoch: {start}
      duration:
        nanoseconds: {duration}
      message_count: {extent.count}
  custom_data: ~
  ros_distro: jazzy
"""
    return f"{head}\n{body}{tail}" if body else f"{head} []\n{tail}"


def _topic_yaml(topic: Topic, count: int) -> str:
    return f"""\
    - topic_metadata:
        name: {topic.name}
        type: {topic.type}
        serialization_format: cdr
        offered_qos_profiles:
{qos_yaml(topic.offered, " " * 10)}
        type_description_hash: {topic.hash or '""'}
      message_count: {count}
"""
