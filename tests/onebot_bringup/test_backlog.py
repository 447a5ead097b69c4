"""What waits for a viewer that reads more slowly than a recording grows."""

import asyncio

from hypothesis import given
from hypothesis import strategies as st

from onebot_bringup.serving import backlog
from onebot_bringup.serving.backlog import Backlog
from onebot_bringup.serving.rerun_messages import subject


def test_a_viewer_that_joins_gets_the_past_whole(monkeypatch):
    """In order, though more comes at once than may wait: then that waits, for a while."""
    monkeypatch.setattr(backlog, "MOST", 500)
    monkeypatch.setattr(backlog, "LONGEST", 1000.0)  # seconds
    monkeypatch.setattr(backlog, "subject", len)  # all are about the same
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
    assert subject(data) != subject(data)
