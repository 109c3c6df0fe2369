"""The stall sentinel: what the machine itself does to a process that wants to run every millisecond."""

from __future__ import annotations

import json
import signal
import time
from pathlib import Path

NOTEWORTHY_NS = 10_000_000


def run_sentinel(stalls: Path) -> None:
    """Note every sleep of a millisecond that took more than ten, as {"at_ns", "stall_ms"} lines, until stopped."""
    going = True

    def stop(*_: object) -> None:
        nonlocal going
        going = False

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)
    with stalls.open("w", encoding="utf-8", buffering=1) as file:
        before = time.time_ns()
        while going:
            time.sleep(0.001)
            now = time.time_ns()
            if now - before > NOTEWORTHY_NS:
                file.write(json.dumps({"at_ns": now, "stall_ms": (now - before) / 1e6}) + "\n")
            before = now
