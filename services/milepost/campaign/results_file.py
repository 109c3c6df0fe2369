"""The file of finished runs: one JSON object a line, so that a campaign that was ended goes on where it was."""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from milepost.config.yaml_files import ConfigError

from .task import Figures, Task


class ResultsFile:
    """Finished runs by their task's key."""

    def __init__(self, path: Path, file: BinaryIO) -> None:
        self._path, self._file = path, file
        self._found: dict[str, Figures] = {}
        self._read()

    def get(self, task: Task) -> Figures | None:
        """The figures of a run that was finished before."""
        return self._found.get(task.key)

    def add(self, task: Task, figures: Figures) -> None:
        """Append a finished run; it is in the file when this returns."""
        line = json.dumps({"key": task.key, **task.as_dict(), "figures": figures})
        self._file.write(line.encode() + b"\n")
        self._file.flush()

    def _read(self) -> None:
        content = self._file.read()
        # whoever was killed while it wrote left a last line without its end: that run is made again
        whole = content.rfind(b"\n") + 1
        for number, line in enumerate(content[:whole].splitlines(), start=1):
            try:
                entry: dict[str, Any] = json.loads(line)
                self._found[entry["key"]] = dict(entry["figures"])
            except (ValueError, KeyError, TypeError, RecursionError) as error:
                raise ConfigError(self._path, f"line {number}", "not a result of a campaign") from error
        self._file.seek(whole)
        self._file.truncate()


@contextmanager
def results_file(path: Path | None) -> Iterator[ResultsFile | None]:
    """The file at `path`, made if there is none and locked for this campaign; None without a path. Raises ConfigError."""
    if path is None:
        yield None
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("a+b")
    except OSError as error:
        raise ConfigError(path, "", error.strerror or str(error)) from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise ConfigError(path, "", "is in use by another campaign") from error
        file.seek(0)
        yield ResultsFile(path, file)
