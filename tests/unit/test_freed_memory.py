"""Memory that was freed goes back to the system."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the C library is not glibc")

# what is freed below something that is still in use stays in the process: 50 MB in blocks of a kilobyte
PROGRAM = """
import ctypes, os, time
from milepost.runtime.freed_memory import giving_back

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

libc = ctypes.CDLL(None)
libc.malloc.restype = ctypes.c_void_p
begin = resident()
blocks = [ctypes.c_void_p(libc.malloc(1000)) for _ in range(50_000)]
for block in blocks:
    ctypes.memset(block, 1, 1000)
for block in blocks[:-1]:
    libc.free(block)
del blocks[:-1]
kept = resident()
with giving_back(0.01):
    until = time.monotonic() + 20.0
    while resident() - begin > 0.5 * (kept - begin) and time.monotonic() < until:
        time.sleep(0.01)
print(kept - begin, resident() - begin)
"""


def test_what_was_freed_below_something_in_use_goes_back() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    kept, left = map(int, done.stdout.split())
    assert kept > 40e6
    assert left < 0.5 * kept
