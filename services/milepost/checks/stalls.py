"""The stall sentinel: when a processor of this machine ran nobody, because its host gave it to others."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

# the beginning and the end of a stall
Stall = tuple[int, int]
NOTEWORTHY_NS = 10_000_000
# the lowest: that is enough to go before every ordinary process
REAL_TIME_PRIORITY = 1


def run_sentinel(stalls: Path) -> None:
    """Note every sleep of a millisecond that took more than ten, as {"at_ns", "stall_ms"} lines, until stopped.

    A virtual machine's processors stand still one by one, each with the process that is on it, while the others go on. So
    each is watched by a thread of its own, which goes before every process that could only be busy. Where that is not
    permitted, one ordinary thread sees no more than the times in which all processors stand still.
    """
    done = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: done.set())
    with stalls.open("w", encoding="utf-8", buffering=1) as file:

        def note(at_ns: int, stall_ns: int) -> None:
            file.write(json.dumps({"at_ns": at_ns, "stall_ms": stall_ns / 1e6}) + "\n")

        threads = [threading.Thread(target=_watch, args=(cpu, done, note)) for cpu in _processors()]
        for thread in threads:
            thread.start()
        # a wait without end would not see the signal on every system
        while not done.wait(0.5):
            pass
        for thread in threads:
            thread.join()


def _processors() -> Sequence[int | None]:
    """The processors to watch; [None] where a thread may not go before others."""
    try:
        os.sched_setscheduler(threading.get_native_id(), os.SCHED_FIFO, os.sched_param(REAL_TIME_PRIORITY))
    except (AttributeError, PermissionError):
        return [None]
    os.sched_setscheduler(threading.get_native_id(), os.SCHED_OTHER, os.sched_param(0))
    return sorted(os.sched_getaffinity(0))


def _watch(cpu: int | None, done: threading.Event, note: Callable[[int, int], None]) -> None:
    if cpu is not None:
        thread = threading.get_native_id()
        os.sched_setaffinity(thread, {cpu})
        os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(REAL_TIME_PRIORITY))
    before = time.time_ns()
    while not done.is_set():
        time.sleep(0.001)
        now = time.time_ns()
        if now - before > NOTEWORTHY_NS:
            note(now, now - before)
        before = now


def read_stalls(path: Path) -> list[Stall]:
    """What a sentinel has noted so far, in order; stalls of several processors at once are one. Empty without a file."""
    if not path.is_file():
        return []
    # the last line may be half written
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line.endswith("}")]
    return joined([(line["at_ns"] - round(line["stall_ms"] * 1e6), line["at_ns"]) for line in lines])


def joined(stalls: Sequence[Stall]) -> list[Stall]:
    """The times in which there was any of these stalls, in order."""
    out: list[Stall] = []
    for begin, end in sorted(stalls):
        if out and begin <= out[-1][1]:
            out[-1] = out[-1][0], max(out[-1][1], end)
        else:
            out.append((begin, end))
    return out


def stalled_ns(stalls: Sequence[Stall], begin_ns: int, end_ns: int) -> int:
    """How long of a time was within stalls, which do not overlap."""
    return sum(max(0, min(end, end_ns) - max(begin, begin_ns)) for begin, end in stalls)
