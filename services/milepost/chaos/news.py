"""Waiting for what is heard, without holding up who hears it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

# looked at so often where nothing is heard
AT_LEAST_EVERY_S = 0.5


class NotInTime(AssertionError):
    """What was waited for did not come."""


class News:
    """Somebody looks again whenever something is heard.

    Who hears never waits for who looks: the next receipt would be stamped late, and a gap measured that was none.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._heard = 0

    def heard(self) -> None:
        """Something came."""
        with self._changed:
            self._heard += 1
            self._changed.notify_all()

    def wait_for(self, what: Callable[[], Any], timeout_s: float, why: str) -> Any:
        """Wait until `what()` is true, looked at whenever something is heard; returns it. Raises NotInTime."""
        deadline = time.monotonic() + timeout_s
        while True:
            before = self._heard
            if found := what():
                return found
            left_s = deadline - time.monotonic()
            if left_s <= 0.0:
                raise NotInTime(f"not within {timeout_s:g} s: {why}")
            with self._changed:
                if self._heard == before:
                    self._changed.wait(min(left_s, AT_LEAST_EVERY_S))
