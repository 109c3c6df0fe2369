"""Memory that was freed, back to the system."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from typing import Any

# mallopt's M_ARENA_MAX
ARENAS, MOST_ARENAS = -8, 2
# so often what is free is given back
EVERY_S = 10.0


def keep_together() -> None:
    """Have glibc serve all threads from two arenas: each further one keeps what was freed in it for its own threads."""
    _glibc("mallopt", ARENAS, MOST_ARENAS)


def give_back() -> None:
    """Have glibc return the free pages of all arenas: after a burst it keeps them for the next one."""
    _glibc("malloc_trim", 0)


def _glibc(name: str, *arguments: int) -> None:
    """Call a function that only glibc has; nothing happens elsewhere."""
    function: Callable[..., Any] | None = getattr(ctypes.CDLL(None), name, None) if sys.platform == "linux" else None
    if function is not None:
        function(*arguments)
