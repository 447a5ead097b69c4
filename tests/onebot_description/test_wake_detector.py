"""When this process woke. No ROS."""

import math

from onebot_description.timing.wake_detector import WakeDetector


def test_a_process_that_did_not_run_has_woken() -> None:
    """A gap between two checks tells it, or SIGCONT, which two threads may notice."""
    now = [100.0]
    wake = WakeDetector(lambda: now[0])
    for _ in range(50):
        now[0] += 0.4
        assert wake.check() == -math.inf
    now[0] += 3600.0
    assert wake.check() == wake.woke == now[0]
    now[0] += 1.0
    wake.resumed()
    assert wake.woke == now[0] == wake.check() + 0.0
    first = now[0]
    now[0] += 0.02
    wake.resumed()
    assert wake.check() == first


def test_a_stop_soon_after_a_gap_counts() -> None:
    """A process that starts slowly has a gap, and may be stopped before it has run for long."""
    now = [100.0]
    wake = WakeDetector(lambda: now[0])
    now[0] += 0.6
    assert wake.check() == now[0]
    now[0] += 0.1
    wake.resumed()
    assert wake.woke == now[0]


def test_a_message_that_is_handled_before_the_signal_waits_for_it() -> None:
    """After a gap that may be a short stop; if no signal comes, it was none."""
    now, signals = [100.0], list[float]()

    def clock() -> float:
        now[0] += 0.001  # as the computer's, it goes on
        if signals and now[0] > signals[0]:
            signals.clear()
            wake.resumed()
        return now[0]

    wake = WakeDetector(clock)
    now[0] += 0.2
    assert wake.certain() == -math.inf
    now[0] += 0.2
    signals.append(signal := now[0] + 0.02)
    assert 0.0 < wake.certain() - signal < 0.01


def test_what_arrives_soon_after_a_wake_may_be_older() -> None:
    now = [100.0]
    wake = WakeDetector(lambda: now[0])
    assert not wake.just_woke()
    now[0] += 5.0
    assert wake.just_woke()
    now[0] += 0.2
    assert wake.just_woke()
    now[0] += 0.1
    assert not wake.just_woke()
