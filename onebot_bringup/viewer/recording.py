"""The recording: served on loopback, written to a file, or both."""

from dataclasses import dataclass
from pathlib import Path

import rerun as rr

from onebot_bringup.viewer.processes import LOOPBACK, free_port
from onebot_description.errors import OneBotError

# Saved blueprints (.rbl) belong to an application: never change it, or they are no longer found.
APPLICATION = "onebot"


@dataclass(frozen=True)
class Recording:
    """An open recording; the server lives as long as ``stream`` is referenced.

    Attributes:
        stream: where to log.
        port: of the gRPC server on 127.0.0.1, None if nothing is served.
        file: the file written, or None.
    """

    stream: rr.RecordingStream
    port: int | None
    file: Path | None

    @property
    def uri(self) -> str:
        """Where viewers connect."""
        return f"rerun+http://{LOOPBACK}:{self.port}/proxy"

    def close(self) -> None:
        """Write out everything and end the server."""
        self.stream.flush(timeout_sec=2.0)
        self.stream.disconnect()


def open_recording(
    port: int | None = None, save: Path | None = None, memory_limit: str = "256MB"
) -> Recording:
    """Open a recording that is served on 127.0.0.1:``port``, written to ``save``, or both.

    Args:
        port: wanted port, another one is taken if it is in use (0: any); None serves nothing.
        save: a ``.rrd`` file, replaced if it exists.
        memory_limit: what the server keeps for viewers that join later, such as "256MB"; beyond
            it, the oldest moving data is dropped, but nothing static.

    Raises:
        OneBotError: the file cannot be written.
    """
    sinks: list[rr.GrpcServerSink | rr.FileSink] = []
    if port is not None:
        port = free_port(port)
        sinks.append(
            rr.GrpcServerSink(bind_ip=LOOPBACK, port=port, server_memory_limit=memory_limit)
        )
    if save is not None:
        check_writable(save)
        # A footer would keep a record of every chunk in memory: nothing for a run of days.
        sinks.append(rr.FileSink(save, write_footer=False))
    if not sinks:
        raise OneBotError("nothing to log to: serve the recording or save it")
    stream = rr.RecordingStream(APPLICATION)
    stream.set_sinks(*sinks)
    return Recording(stream, port, save)


def check_writable(path: Path) -> None:
    """Refuse a recording file that cannot be written.

    Raises:
        OneBotError: with what is wrong.
    """
    if path.suffix != ".rrd":
        raise OneBotError(f"save:={path}: a recording's name must end in .rrd")
    if not path.parent.is_dir():
        raise OneBotError(f"save:={path}: there is no folder {path.parent}")
    try:
        path.open("ab").close()
    except OSError as error:
        raise OneBotError(f"save:={path}: {error.strerror}") from error
