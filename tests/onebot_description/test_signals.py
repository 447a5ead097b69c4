"""SIGINT and SIGTERM as a call, from whatever the main thread is in."""

import signal
import threading

import pytest

from onebot_description.signals import StopSignals


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_calls_and_does_not_interrupt(number: signal.Signals) -> None:
    """The main thread goes on; the call comes from another one."""
    called = threading.Event()
    with StopSignals(called.set):
        signal.raise_signal(number)
        assert called.wait(60.0)


def test_what_may_be_given_up_is_interrupted() -> None:
    """By a signal that comes within it, and by one that came before."""
    called = threading.Event()
    with StopSignals(called.set) as signals:
        with pytest.raises(KeyboardInterrupt), signals.interrupting():
            signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)  # cleaning up is not
        with pytest.raises(KeyboardInterrupt), signals.interrupting():
            raise AssertionError("this was to be left out")
        assert called.wait(60.0)


def test_the_former_handlers_come_back() -> None:
    """As they were, once it is left."""
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with StopSignals(lambda: None):
        assert signal.getsignal(signal.SIGINT) != before[0]
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before
