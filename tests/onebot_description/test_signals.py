"""Signals that ask to stop: as a call from another thread, and as KeyboardInterrupt."""

import signal
import subprocess
import sys
import threading

import pytest

from onebot_description.ros.signals import KeyboardInterrupts, StopSignals, stop_signals
from tests.support import PATIENCE


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_calls_and_does_not_interrupt(number: signal.Signals) -> None:
    called = threading.Event()
    with StopSignals(called.set):
        signal.raise_signal(number)
        assert called.wait(PATIENCE)


def test_a_continued_process_is_not_asked_to_stop() -> None:
    stopped, resumed = threading.Event(), threading.Event()
    with StopSignals(stopped.set, resumed.set):
        signal.raise_signal(signal.SIGCONT)
        assert resumed.wait(PATIENCE)
        signal.raise_signal(signal.SIGCONT)
        assert not stopped.is_set()
        signal.raise_signal(signal.SIGTERM)
        assert stopped.wait(PATIENCE)


def test_what_may_be_given_up_is_interrupted() -> None:
    called = threading.Event()
    with StopSignals(called.set) as signals:
        with pytest.raises(KeyboardInterrupt), signals.interrupting():
            signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)  # cleaning up is not
        with pytest.raises(KeyboardInterrupt), signals.interrupting():
            raise AssertionError("this was to be left out")
        assert called.wait(PATIENCE)


def test_an_interruption_stays_one() -> None:
    with StopSignals(lambda: None) as signals:
        with pytest.raises(TypeError), signals.interrupting():
            raise TypeError("no signal came")
        with pytest.raises(KeyboardInterrupt), signals.interrupting():
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt as error:
                raise TypeError("cannot convert the return value") from error


def test_the_former_handlers_come_back() -> None:
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with StopSignals(lambda: None):
        assert signal.getsignal(signal.SIGINT) != before[0]
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_command_is_interrupted(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with KeyboardInterrupts() as interrupts:
        interrupts.check()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
        with pytest.raises(KeyboardInterrupt):
            interrupts.check()
    assert signal.getsignal(number) == before


def test_an_interrupt_is_deferred() -> None:
    """What is ended in order goes on after the first signal, but not after a second one."""
    for count in (1, 2):
        ended = []
        with (
            KeyboardInterrupts() as interrupts,
            pytest.raises(KeyboardInterrupt),
            interrupts.deferred() as interrupted,
        ):
            assert not interrupted()
            for _ in range(count):
                signal.raise_signal(signal.SIGINT)
                assert interrupted()
            ended.append(True)
        assert bool(ended) == (count == 1)


@pytest.mark.parametrize(
    "context", ["KeyboardInterrupts()", "StopSignals(int) as signals, signals.interrupting()"]
)
def test_the_exit_code_stays_after_an_interrupted_exec(context: str) -> None:
    """Modules that are imported at that moment make their dataclasses by exec()."""
    code = f"""
import signal
from contextlib import suppress
from onebot_description.ros.signals import KeyboardInterrupts, StopSignals
with suppress(KeyboardInterrupt), {context}:
    exec("signal.raise_signal(signal.SIGINT)")
"""
    done = subprocess.run([sys.executable, "-c", code], timeout=PATIENCE)
    assert done.returncode == 0


def test_nohup_is_respected() -> None:
    numbers = (signal.SIGHUP, signal.SIGINT)
    before = {number: signal.signal(number, signal.SIG_IGN) for number in numbers}
    try:
        assert set(stop_signals()) == {signal.SIGINT, signal.SIGTERM}
        with KeyboardInterrupts():
            signal.raise_signal(signal.SIGHUP)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
