"""What a filter keeps on disk from one run to the next: one small file for each unit that has something to keep."""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Iterable
from pathlib import Path

from milepost.nodes.base import Node, Output
from milepost.nodes.filter import FilterNode

from .logs.records import log_event

log = logging.getLogger("milepost")
WRITE_EVERY_NS = 5 * 10**9
LARGEST_BYTES = 65536


class CalibrationStore:
    """Reads and writes a filter's file in a folder; a failure of the disk is logged and changes nothing else."""

    def __init__(self, node: FilterNode, path: Path) -> None:
        self._node = node
        self._path = path
        self._written_ns: int | None = None
        self._failing = False

    def restore(self, now_ns: int) -> Iterable[Output]:
        """Let the filter begin with what was kept, if anything was; yields the event that says so."""
        try:
            with self._path.open("rb") as file:
                kept = file.read(LARGEST_BYTES)
        except FileNotFoundError:
            return
        except OSError as error:
            log.warning("%s: %s", self._path, error.strerror)
            return
        for output in self._node.restore(kept, now_ns):
            log_event(output.message)
            yield output

    def once_a_second(self, now_ns: int) -> None:
        """Write every five seconds."""
        if self._written_ns is None or now_ns - self._written_ns >= WRITE_EVERY_NS:
            self._written_ns = now_ns
            self.write()

    def write(self) -> None:
        """Write now: a whole file or none, whenever the process or the machine ends."""
        kept = self._node.snapshot()
        if kept is None:
            return
        temporary = self._path.with_name(f".{self._path.name}.{os.getpid()}")
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with temporary.open("wb") as file:
                file.write(kept)
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(self._path)
        except OSError as error:
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)
            if not self._failing:
                log.warning("%s: %s; what was learned is not kept", self._path, error.strerror)
            self._failing = True
        else:
            self._failing = False


def calibration_store_for(node: Node, train: str, folder: Path | None) -> CalibrationStore | None:
    """The store of a filter's node; without a folder nothing is kept."""
    own = node.innermost
    if folder is None or not isinstance(own, FilterNode):
        return None
    return CalibrationStore(own, folder / f"{train}.{node.unit}.json")
