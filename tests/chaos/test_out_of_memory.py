"""A process that ends while it may have no more memory."""

from __future__ import annotations

import os
import signal
import threading

import pytest

from milepost.chaos.stack import NORMAL_S, Stack

pytestmark = [pytest.mark.system, pytest.mark.long]


def test_what_ends_for_want_of_memory_is_started_again_whoever_started_it(stack: Stack) -> None:
    """GIVEN a filter that was replaced by hand WHEN it ends while it may have no more memory THEN it comes back."""
    stack.terminate("filter-loop")
    stack.start("filter-loop")
    stack.back("filter-loop", NORMAL_S)
    ended = stack.pid("filter-loop")
    # whether an allocation fails within two seconds is chance, and so is how: the kernel may end it too
    threading.Timer(0.5, os.kill, (ended, signal.SIGKILL)).start()
    stack.starve("filter-loop", 2.0)
    stack.recovered(NORMAL_S)
    assert stack.pid("filter-loop") != ended
