"""The stall sentinel beside the train: a process that wants to run every millisecond, and notes when it could not."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .figures import Stall


class Sentinel:
    """Reads what the sentinel's process has noted so far."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def stalls(self) -> list[Stall]:
        """All stalls of the machine of more than 10 ms until now."""
        if not self._path.is_file():
            return []
        found = [json.loads(line) for line in self._path.read_text(encoding="utf-8").splitlines() if line.endswith("}")]
        return [(each["at_ns"] - round(each["stall_ms"] * 1e6), each["at_ns"]) for each in found]


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
