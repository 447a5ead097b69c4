"""What waits for a viewer that reads more slowly than a recording grows."""

import asyncio

import aiohttp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from onebot_bringup.serving import backlog
from onebot_bringup.serving.backlog import Backlog
from onebot_bringup.serving.rerun_messages import GRPC_WEB, HEAD, SERVICE, subjects
from onebot_bringup.viewer.core.transform_stream import TransformStream
from onebot_bringup.viewer.display_server import open_recording
from onebot_description.ros.frame_tree import FrameTree
from onebot_description.ros.wire.message_arrays import TfArrays
from tests.onebot_bringup.viewer_support import START_NS, transforms

_TWO = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]] * 2)  # poses of two frames


def test_a_viewer_that_joins_gets_the_past_whole(monkeypatch):
    """In order, though more comes at once than may wait: then that waits, for a while."""
    monkeypatch.setattr(backlog, "MAX_SIZE", 500)
    monkeypatch.setattr(backlog, "LONGEST", 1000.0)  # seconds
    monkeypatch.setattr(backlog, "subjects", lambda _: [0])  # all are about the same
    past = [bytes([number]) * 100 for number in range(1, 100)]

    async def run() -> list[bytes]:
        waiting = Backlog()

        async def fill() -> None:
            for message in past:
                await waiting.put(message)
            waiting.end()

        filling = asyncio.ensure_future(fill())
        taken = []
        while message := await waiting.get():
            taken.append(message)
        await filling
        return taken

    assert asyncio.run(run()) == past


@given(st.binary(max_size=200))
def test_bytes_that_rerun_did_not_write_are_a_subject_of_their_own(data):
    """They are kept, and end nothing."""
    assert subjects(data) != subjects(data)


def _about(message: bytes) -> tuple[object, ...]:
    about = subjects(message)[0]
    return about if isinstance(about, tuple) else ()


def test_frames_that_come_seldom_are_kept(monkeypatch):
    """All transforms are of one entity; the latest message with each frame is kept, once."""
    recording = open_recording(0)
    stream = TransformStream(recording.stream, FrameTree())
    both = TfArrays(("odom",) * 2, ("base", "mast"), np.zeros(2, np.int64), *np.split(_TWO, [3], 1))
    for item in (both, transforms("base", "tip", 0.0), *[transforms("odom", "base", 0.0)] * 2):
        stream.add(START_NS, item)
        stream.flush()
    recording.stream.flush()
    url = "http://{}:{}".format(*recording.server) + f"/{SERVICE}/ReadMessages"

    async def run() -> None:
        async with (
            aiohttp.ClientSession(headers={"content-type": GRPC_WEB, "x-grpc-web": "1"}) as session,
            session.post(url, data=bytes(HEAD)) as answer,
        ):
            read = []
            async for message in backlog.messages(answer.content):
                read += [message] if b"/tf" in _about(message) else []
                if len(read) == 4:
                    break
        monkeypatch.setattr(backlog, "LONGEST", -1.0)  # seconds
        waiting = Backlog()
        for message in read:
            await waiting.put(message)
        waiting.end()
        kept = [await waiting.get() for _ in range(4)]
        assert kept == [read[0], read[1], read[3], b""]

    asyncio.run(run())
    recording.close()
