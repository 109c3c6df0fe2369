"""Rarer garbage collection during an offline run."""

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
