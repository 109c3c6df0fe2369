"""The wait for the next thing in an inbox."""

from __future__ import annotations

import queue
from typing import TypeVar

T = TypeVar("T")


def take(inbox: queue.SimpleQueue[T], wait_s: float) -> T:
    """The next item, for which the only reader of an inbox waits at most `wait_s`. Raises queue.Empty.

    `SimpleQueue.get(timeout=...)` alone may never return (CPython 3.11): after an item that needed no wait it tries once
    more, with the rest of the time, which is negative where the processor was taken away meanwhile, and that means for ever.
    """
    try:
        return inbox.get_nowait()
    except queue.Empty:
        # whoever looked in vain begins the wait itself with nothing to try again
        if wait_s <= 0.0:
            raise
        return inbox.get(timeout=wait_s)
