"""A recording in other formats. What is not a message of the stream table is left out, and counted."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from milepost.config.errors import ConfigError
from milepost_schemas import Message, Refused, Stream, from_fields, unpack

from .columns import RECEIVED
from .incoming import Incoming
from .reading import McapReader
from .rows import row_of
from .window import ALL, Window

PROGRESS_EVERY = 500


class Output(Protocol):
    """A format: takes messages until it is closed; `written`: its files or folder."""

    written: list[Path]

    def add(self, row: Stream, message: Message, fields: dict[str, Any], at_ns: int) -> None:
        """Take a message; `fields` are its own, and the time of receipt in tables."""

    def close(self) -> None:
        """Finish the files."""


@dataclass
class Exported:
    """What was done."""

    messages: int = 0
    written: list[Path] = field(default_factory=list)
    refused: dict[str, int] = field(default_factory=dict)
    flaws: list[str] = field(default_factory=list)

    @property
    def lines(self) -> list[str]:
        """The same as sentences."""
        out = [f"{self.messages} messages -> {', '.join(map(str, self.written))}"]
        out += [f"left out {count}: {reason}" for reason, count in self.refused.items()]
        return out + self.flaws


@contextmanager
def outputs(csv: Path | None, parquet: Path | None, foxglove: Path | None, files: Sequence[Path]) -> Iterator[list[Output]]:
    """The formats asked for, each closed afterwards. Raises ConfigError for a place that cannot be written."""
    from .tables import CsvTables, ParquetTables

    with ExitStack() as stack:
        made: list[Output] = []
        try:
            if csv is not None:
                made.append(stack.enter_context(closing(CsvTables(csv))))
            if parquet is not None:
                made.append(stack.enter_context(closing(ParquetTables(parquet))))
            if foxglove is not None:
                made.append(stack.enter_context(closing(_foxglove(foxglove, files))))
        except OSError as error:
            raise ConfigError(error.filename or "export", "", error.strerror or str(error)) from error
        yield made


def _foxglove(path: Path, files: Sequence[Path]) -> Output:
    from .foxglove import FoxgloveFile

    if any(path.exists() and path.samefile(file) for file in files):
        raise ConfigError(path, "", "is the recording itself: name another file for --foxglove")
    return FoxgloveFile(path)


def export(files: Sequence[Path], writers: Sequence[Output], progress: Callable[[int], None], window: Window = ALL) -> Exported:
    """Write all messages of a window. Raises ConfigError, OSError."""
    done, before = Exported(), 0
    for path in files:
        reader = McapReader(path, window)
        for number, incoming in enumerate(reader.messages()):
            _one(incoming, writers, done)
            if number % PROGRESS_EVERY == 0:
                progress(before + reader.read_bytes)
        before += path.stat().st_size
        done.flaws += reader.flaws
    done.written = [path for writer in writers for path in writer.written]
    return done


def _one(incoming: Incoming, writers: Sequence[Output], done: Exported) -> None:
    row = row_of(incoming.key, incoming.encoding)
    if row is None:
        reason = "not in the stream table"
    else:
        try:
            message = from_fields(unpack(incoming.payload), row.message)
            fields = message.model_dump()
            for writer in writers:
                writer.add(row, message, {RECEIVED: incoming.at_ns, **fields}, incoming.at_ns)
            done.messages += 1
            return
        except Refused as refused:
            reason = refused.reason
    done.refused[reason] = done.refused.get(reason, 0) + 1
