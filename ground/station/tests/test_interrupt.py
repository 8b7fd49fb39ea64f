"""What ends a command, and what does not."""

from __future__ import annotations

import signal

import pytest
from goshawk_ground.process.interrupt import interrupted


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_ctrl_c_sigterm_and_a_closed_terminal_set_the_event(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with interrupted() as done:
        signal.raise_signal(number)
        assert done.is_set()
    assert signal.getsignal(number) is before


def test_under_nohup_a_closed_terminal_ends_nothing() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interrupted() as done:
            signal.raise_signal(signal.SIGHUP)
            assert not done.is_set()
    finally:
        signal.signal(signal.SIGHUP, before)
