"""What the operating system may do to a process: give it less time, no more memory, no room on the disk."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress

import psutil

# a slowed process runs for a part of each of these
SLICE_S = 0.02


def slowed(pid: int, times: float, for_s: float) -> None:
    """Let a process run for one part in `times` of the time, for so long; returns then."""
    end = time.monotonic() + for_s
    try:
        while time.monotonic() < end:
            os.kill(pid, signal.SIGSTOP)
            time.sleep(SLICE_S * (1.0 - 1.0 / times))
            os.kill(pid, signal.SIGCONT)
            time.sleep(SLICE_S / times)
    finally:
        os.kill(pid, signal.SIGCONT)


def no_more_memory(pid: int, for_s: float) -> None:
    """Let a process have no more address space than it has, for so long; returns then. It may end for want of it."""
    victim = psutil.Process(pid)
    with _limited(victim, psutil.RLIMIT_AS, victim.memory_info().vms):
        time.sleep(for_s)


@contextmanager
def disk_full(pids: Sequence[int]) -> Iterator[None]:
    """Inside this block, the kernel refuses every byte that these processes write to a file."""
    with ExitStack() as entered:
        for pid in pids:
            entered.enter_context(_limited(psutil.Process(pid), psutil.RLIMIT_FSIZE, 0))
        yield


@contextmanager
def _limited(victim: psutil.Process, what: int, most: int) -> Iterator[None]:
    soft, hard = victim.rlimit(what)
    victim.rlimit(what, (most, hard))
    try:
        yield
    finally:
        # it may have ended for want of it
        with suppress(psutil.NoSuchProcess):
            victim.rlimit(what, (soft, hard))
