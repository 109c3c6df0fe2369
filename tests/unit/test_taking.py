"""The wait for what comes ends in its time, whoever else wants the processor."""

from __future__ import annotations

import os
import queue
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

import milepost
from milepost.runtime.inbox.taking import take

# after each item nothing comes, and the wait for it is over before it begins if the processor is taken away
MANY_SHORT_WAITS = """
import os, queue, time
from milepost.runtime.inbox.taking import take
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
inbox, end = queue.SimpleQueue(), time.monotonic() + 3.0
while time.monotonic() < end:
    inbox.put("item")
    assert take(inbox, 1e-6) == "item"
    try:
        take(inbox, 1e-6)
        raise AssertionError("nothing was there")
    except queue.Empty:
        pass
"""
BUSY = "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\nwhile True: pass"


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="processes cannot be kept on one processor here")
def test_a_wait_ends_though_the_processor_is_taken_away_just_as_it_begins() -> None:
    """GIVEN a busy process on the same processor, WHEN a reader waits a microsecond, over and over, THEN each wait ends.

    With `SimpleQueue.get(timeout=...)` alone one of them never ended within the first thousands.
    """
    with subprocess.Popen([sys.executable, "-c", BUSY]) as busy:
        try:
            done = subprocess.run([sys.executable, "-c", MANY_SHORT_WAITS], timeout=60.0, check=False)
        finally:
            busy.kill()
    assert done.returncode == 0


def test_a_wait_takes_its_time_and_no_longer() -> None:
    inbox: queue.SimpleQueue[int] = queue.SimpleQueue()
    begun = time.monotonic()
    with pytest.raises(queue.Empty):
        take(inbox, 0.05)
    assert time.monotonic() - begun >= 0.05
    for wait_s in (0.0, -1.0):
        with pytest.raises(queue.Empty):
            take(inbox, wait_s)
    inbox.put(1)
    inbox.put(2)
    assert [take(inbox, 1.0), take(inbox, -1.0)] == [1, 2]


def test_nobody_waits_in_another_way() -> None:
    """`SimpleQueue.get` with a time limit is called in one place."""
    services = Path(milepost.__file__).parent
    found = [path.name for path in sorted(services.rglob("*.py")) if re.search(r"\.get\(timeout=", path.read_text())]
    assert found == ["taking.py"]
