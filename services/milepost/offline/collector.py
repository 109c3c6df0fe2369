"""Python's garbage collector, told that messages are not its business."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

# messages are freed by reference count; looking at every seven hundred of them for cycles costs a tenth of the time
GC_THRESHOLDS = (20_000, 20, 20)


@contextmanager
def rare_collection() -> Iterator[None]:
    """Collect rarely while inside, and leave what is there now alone; afterwards as before."""
    before = gc.get_threshold()
    gc.collect()
    gc.freeze()
    gc.set_threshold(*GC_THRESHOLDS)
    try:
        yield
    finally:
        gc.set_threshold(*before)
        gc.unfreeze()
