"""Stops: who asks for one, how often, and what it ends."""

from __future__ import annotations

import os
import signal

import pytest

from lfobench.schedule.execution import StopRequest


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_first_signal_asks_for_a_stop(number: signal.Signals) -> None:
    announced: list[bool] = []
    stop = StopRequest(lambda: announced.append(True))
    before = signal.getsignal(number)
    with stop.listening():
        os.kill(os.getpid(), number)
        assert stop()
    assert announced == [True]
    assert signal.getsignal(number) == before


def test_schedulers_repeat_themselves_and_a_user_who_does_means_at_once() -> None:
    stop, went_on = StopRequest(), False
    with stop.listening():
        for number in (signal.SIGHUP, signal.SIGTERM, signal.SIGHUP, signal.SIGTERM):
            os.kill(os.getpid(), number)
        went_on = True
        os.kill(os.getpid(), signal.SIGINT)
        pytest.fail("the second Ctrl-C ends the block")
    assert went_on
    assert stop()


def test_nohup_is_obeyed() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        stop = StopRequest()
        with stop.listening():
            os.kill(os.getpid(), signal.SIGHUP)
            assert not stop()
    finally:
        signal.signal(signal.SIGHUP, before)
