"""The stall sentinel beside the train, in a process of its own."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from milepost.checks.stalls import Stall, read_stalls


class Sentinel:
    """Reads what the sentinel's process has noted so far."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def stalls(self) -> list[Stall]:
        """All stalls of the machine of more than 10 ms until now."""
        return read_stalls(self._path)


@contextmanager
def sentinel(folder: Path) -> Iterator[Sentinel]:
    """A sentinel that runs inside this block, and keeps its notes in a folder."""
    path = folder / "stalls.jsonl"
    process = subprocess.Popen([sys.executable, "-m", "milepost", "sentinel", "--stalls", str(path)])
    try:
        yield Sentinel(path)
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(5.0)
