"""SIGINT and SIGTERM as a flag that ends a wait, so that neither interrupts anything halfway."""

from __future__ import annotations

import select
import signal
import socket
from types import TracebackType

STOPPING = (signal.SIGINT, signal.SIGTERM)


def forget_signals() -> None:
    """Give SIGINT, SIGTERM and SIGCHLD their default actions; a forked child calls this first."""
    signal.set_wakeup_fd(-1)
    for number in (*STOPPING, signal.SIGCHLD):
        signal.signal(number, signal.SIG_DFL)


class StopSignals:
    """Inside this context SIGINT and SIGTERM only set `asked`; a child that ends wakes `wait` as well."""

    def __init__(self) -> None:
        self.asked = False
        self._wake, self._woken = socket.socketpair()
        self._wake.setblocking(False)
        self._woken.setblocking(False)

    def __enter__(self) -> StopSignals:
        """Install the handlers."""
        signal.set_wakeup_fd(self._wake.fileno(), warn_on_full_buffer=False)
        for number in STOPPING:
            signal.signal(number, self._ask)
        # a handler is needed for the wake-up, though there is nothing for it to do
        signal.signal(signal.SIGCHLD, lambda *_: None)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Restore the default actions."""
        forget_signals()
        self._wake.close()
        self._woken.close()

    def _ask(self, *_: object) -> None:
        self.asked = True

    def wait(self, seconds: float) -> bool:
        """Sleep until a signal comes or the time is over; returns whether the process was asked to stop."""
        if not self.asked and select.select([self._woken], [], [], seconds)[0]:
            self._woken.recv(4096)
        return self.asked
