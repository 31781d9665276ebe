"""Ctrl-C as a wish for the best so far."""

from __future__ import annotations

import os
import signal

import pytest

from urdfcal.base.interrupts import enough, until_interrupted


def test_the_first_is_heard_and_the_second_ends_it() -> None:
    """Inside a block the first Ctrl-C is a wish, the second an end; outside nothing is wished, and Ctrl-C ends things as ever."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with until_interrupted() as asked:
            assert not enough()
            os.kill(os.getpid(), signal.SIGINT)
            assert enough()
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
        assert asked()
        assert not enough()
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_where_it_is_ignored_it_stays_so() -> None:
    """A process that was started deaf to Ctrl-C does not begin to hear it."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with until_interrupted() as asked:
            os.kill(os.getpid(), signal.SIGINT)
            assert not asked()
    finally:
        signal.signal(signal.SIGINT, before)
