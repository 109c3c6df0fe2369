"""What /proc says of processes: how long they have run, and how much memory they take. Only Linux has it."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable
from pathlib import Path

KIB_PER_MIB = 1024.0


def age_s() -> float:
    """How long ago this process was started, its interpreter's start included; 0 where the system does not tell."""
    try:
        # the name, which stands in brackets, may hold blanks
        fields = Path("/proc/self/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    except OSError:
        return 0.0
    return time.clock_gettime(time.CLOCK_BOOTTIME) - int(fields[19]) / os.sysconf("SC_CLK_TCK")


def proportional_mib(pids: Iterable[int]) -> float:
    """The sum of the proportional set sizes in MiB: a page that n processes share counts 1/n in each."""
    return sum(_proportional_kib(pid) for pid in pids) / KIB_PER_MIB


def _proportional_kib(pid: int) -> int:
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines()
    except OSError:  # it has just ended
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith("Pss:")), 0)
