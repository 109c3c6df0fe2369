"""A recording that goes on: one file after the other, and none where the disk has too little room."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from milepost.config.errors import ConfigError

from .file import RecordingFile, TooManyKeys
from .gaps import Gaps
from .incoming import Incoming, head_of
from .limits import MIB, Limits
from .rows import row_of

NS_PER_S = 1_000_000_000
# what stopped goes on when there is a tenth more room than that, and looks for it so often
ENOUGH, LOOK_AGAIN_NS = 1.1, 5 * NS_PER_S
DISK, KEYS = "disk", "too_many_keys"


class Notice(NamedTuple):
    """Something to be told: its severity, its code in the table of events, a sentence."""

    severity: str
    code: str
    text: str


def free_bytes(folder: Path) -> int:
    """The room on the disk of a folder."""
    return shutil.disk_usage(folder).free


def prepare(folder: Path) -> None:
    """Make the folder of a recording. Raises ConfigError where nothing can be written to it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise ConfigError(folder, "", f"cannot record there: {error.strerror}") from error


class Recorder:
    """Writes messages to files in a folder. Times are UTC; the caller asks for a `check` at least once a second.

    `refused` counts by reason what was not written; `received` counts by stream what was, and `gaps` the sequence numbers that
    are missing in it.
    """

    def __init__(self, folder: Path, train: str, limits: Limits, now_ns: int, free: Callable[[Path], int] = free_bytes) -> None:
        self._folder = folder
        self._train = train
        self._limits = limits
        self._free = free
        self._facts: dict[str, dict[str, str]] = {}
        self._file: RecordingFile | None = None
        self._opened_ns = self._look_ns = self._number = 0
        self._full: str | None = None
        self.notices: list[Notice] = []
        self.received: dict[str, int] = {}
        self.refused: dict[str, int] = {}
        self.gaps = Gaps()
        self.files: list[Path] = []
        prepare(folder)
        try:
            if not self._too_little_room(1.0, now_ns):
                self._open(now_ns)
        except OSError as error:
            raise ConfigError(folder, "", f"cannot record there: {error.strerror}") from error

    @property
    def recording(self) -> bool:
        """Whether what comes is written."""
        return self._file is not None

    def describe(self, name: str, facts: Mapping[str, str], now_ns: int) -> None:
        """Write something about the recording, now and at the beginning of every further file."""
        self._facts[name] = dict(facts)
        if self._file is not None:
            self._write(lambda file: file.describe(name, facts), now_ns)

    def add(self, message: Incoming) -> None:
        """Write one message, or count it where that cannot be."""
        if self._file is None:
            self._refuse(DISK, 1)
            return
        row, head = row_of(message.key, message.encoding), head_of(message.payload)
        try:
            self._file.add(message, head)
        except TooManyKeys:
            self._refuse(KEYS, 1)
            return
        except OSError as error:
            self._failed(error, message.at_ns)
            return
        name = row.name if row else "other"
        self.received[name] = self.received.get(name, 0) + 1
        if head.instance is not None:
            self.gaps.note((message.key, head.instance), head.sequence)

    def check(self, now_ns: int, sync: bool = True) -> None:
        """Have the system, and with `sync` the disk, take what came; begin the next file; stop and go on as there is room."""
        if self._file is None:
            self._go_on(now_ns)
            return
        if not self._write(RecordingFile.sync if sync else RecordingFile.flush, now_ns) or self._too_little_room(1.0, now_ns):
            return
        if self._full is not None:  # the disk has taken something again
            self._full = None
            text = f"recording goes on in {self.files[-1].name}; {self.refused.get(DISK, 0)} messages are missing"
            self._say("info", "recording_resumed", text)
        if self._file.size >= self._limits.rotate_bytes or now_ns - self._opened_ns >= self._limits.rotate_s * NS_PER_S:
            self.close(now_ns)
            self._go_on(now_ns)

    def close(self, now_ns: int) -> None:
        """Finish the file in hand."""
        if self._file is not None and self._write(RecordingFile.close, now_ns):
            self._file = None

    def _go_on(self, now_ns: int) -> None:
        if now_ns < self._look_ns or self._too_little_room(ENOUGH if self._full else 1.0, now_ns):
            return
        try:
            self._open(now_ns)
        except OSError as error:
            self._failed(error, now_ns)

    def _open(self, now_ns: int) -> None:
        self._opened_ns = now_ns
        stamp = datetime.fromtimestamp(now_ns // NS_PER_S, UTC).strftime("%Y%m%dT%H%M%SZ")
        while (path := self._folder / f"{self._train}-{stamp}-{self._number:04}.mcap").exists():
            self._number += 1
        self._number += 1
        self._file = RecordingFile(path)
        self.files.append(path)
        for name, facts in self._facts.items():
            self._file.describe(name, facts)

    def _too_little_room(self, enough: float, now_ns: int) -> bool:
        """Whether the disk has less free than so many times the least; if so, nothing more is written."""
        free, least = self._free(self._folder), self._limits.least_free_bytes
        if free >= enough * least:
            return False
        if self._file is not None:
            self.close(now_ns)
        self._stop(f"{self._folder} has {free // MIB} MiB free, less than {least // MIB} MiB", now_ns)
        return True

    def _write(self, what: Callable[[RecordingFile], None], now_ns: int) -> bool:
        assert self._file is not None
        try:
            what(self._file)
        except OSError as error:
            self._failed(error, now_ns)
            return False
        return True

    def _failed(self, error: OSError, now_ns: int) -> None:
        """The file cannot be written: what was not flushed is lost."""
        if self._file is not None:
            self._refuse(DISK, self._file.unflushed)
            self._file.abandon()
            self.files = [path for path in self.files if path.exists()]
            self._file = None
        self._stop(f"{self._folder} cannot be written: {error.strerror}", now_ns)

    def _stop(self, why: str, now_ns: int) -> None:
        self._look_ns = now_ns + LOOK_AGAIN_NS
        if self._full is None:
            self._full = why
            self._say("error", "recording_stopped", f"recording stopped: {why}")

    def _refuse(self, reason: str, count: int) -> None:
        self.refused[reason] = self.refused.get(reason, 0) + count

    def _say(self, severity: str, code: str, text: str) -> None:
        self.notices.append(Notice(severity, code, text))
