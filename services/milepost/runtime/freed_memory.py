"""Memory that was freed, back to the system."""

from __future__ import annotations

import ctypes
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

# mallopt's M_ARENA_MAX: each further arena keeps what was freed in it for its own threads
ARENAS, MOST_ARENAS = -8, 2
# a trim takes a tenth of a millisecond
EVERY_S = 10.0


@contextmanager
def giving_back(every_s: float = EVERY_S) -> Iterator[None]:
    """A block in which a process now and then returns what its threads have freed: glibc would keep it after each burst."""
    _glibc("mallopt", ARENAS, MOST_ARENAS)
    over = threading.Event()

    def work() -> None:
        while not over.wait(every_s):
            _glibc("malloc_trim", 0)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def _glibc(name: str, *arguments: int) -> None:
    """Call a function that only glibc has; nothing happens elsewhere."""
    function: Callable[..., Any] | None = getattr(ctypes.CDLL(None), name, None) if sys.platform == "linux" else None
    if function is not None:
        function(*arguments)
