"""Rarer garbage collection during a run, and none where times of receipt are measured."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

# messages are freed by reference count; by default the search for cycles takes a tenth of the run time
GC_THRESHOLDS = (20_000, 20, 20)


@contextmanager
def rare_collection() -> Iterator[None]:
    """Collect rarely inside the context and ignore the objects that exist already; restore the thresholds afterwards."""
    before = gc.get_threshold()
    gc.collect()
    gc.freeze()
    gc.set_threshold(*GC_THRESHOLDS)
    try:
        yield
    finally:
        gc.set_threshold(*before)
        gc.unfreeze()


@contextmanager
def no_collection() -> Iterator[None]:
    """Search for no cycles inside the context.

    Who keeps all messages of ten minutes has 10⁶ objects; each search through them holds up all threads for half a second,
    which would be measured as a gap of the sender's. Messages are freed without it.
    """
    before = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if before:
            gc.enable()
