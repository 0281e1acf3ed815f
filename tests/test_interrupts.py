"""Ctrl-C and SIGTERM: when they take effect."""

import os
import signal
from collections.abc import Callable

import pytest

from balloon_warp.interrupts import Interrupts


def press(interrupts: Interrupts) -> None:
    os.kill(os.getpid(), signal.SIGINT)
    assert interrupts.pending


def done_of(work: list[Callable[[Interrupts], None]], message: str) -> int:
    """Return the number of work items done with Ctrl-C deferred, until it is raised with a message."""
    done = 0

    def run() -> None:
        nonlocal done
        with Interrupts() as interrupts:
            for step in work:
                step(interrupts)
                done += 1

    with pytest.raises(KeyboardInterrupt, match=f"^{message}$"):
        run()
    return done


def test_ctrl_c_waits_until_it_is_delivered():
    assert done_of([press, lambda _: None, lambda interrupts: interrupts.deliver("so far")], "so far") == 2


def test_ctrl_c_that_nobody_delivered_comes_at_the_end():
    assert done_of([press, lambda _: None], "") == 2


def test_a_second_ctrl_c_is_not_held_back():
    """A second Ctrl-C interrupts at once, without waiting for the frame."""
    assert done_of([press, press, lambda _: None], "") == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_handlers_are_those_of_before(number: signal.Signals):
    before = signal.signal(number, handler := lambda *_: None)
    try:
        with Interrupts():
            assert signal.getsignal(number) is not handler
        assert signal.getsignal(number) is handler
    finally:
        signal.signal(number, before)
