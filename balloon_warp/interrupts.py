"""Interrupts, Ctrl-C and SIGTERM, deferred to points where work can stop."""

import signal
import threading
from types import FrameType, TracebackType
from typing import Any, Self


class Interrupts:
    """Notes the signals that come while its `with` block runs, for the block to act on when it can.

    A second signal is not held back. Outside the main thread, which alone gets signals, it notes none; nor does it a
    signal that no Python function handles.
    """

    def __init__(self) -> None:
        self._handlers: dict[int, Any] = {}
        self._come: tuple[int, FrameType | None] | None = None

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                if callable(handler := signal.getsignal(number)):
                    self._handlers[number] = handler
                    signal.signal(number, self._note)
        return self

    @property
    def pending(self) -> bool:
        """Return whether a signal has come."""
        return self._come is not None

    def deliver(self, message: str = "") -> None:
        """Deliver a signal that has come, as its own handler would.

        Raises:
            KeyboardInterrupt: with that message, where the signal's own handler raises it.
        """
        if self._come:
            number, frame = self._come
            self._come = None
            try:
                self._handlers[number](number, frame)
            except KeyboardInterrupt:
                raise KeyboardInterrupt(message) from None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        if kind is None:
            self.deliver("")

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self._come:
            self._come = None
            self._handlers[number](number, frame)
        else:
            self._come = number, frame
