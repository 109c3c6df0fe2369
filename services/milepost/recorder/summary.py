"""What is in a recording: its trains, its span, the messages of each stream and sender, and what is missing."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from .gaps import Gaps, Run
from .incoming import Incoming, head_of
from .reading import McapReader
from .rows import place_of, row_of

# what has no row in the stream table
OTHER = "other"


class Sender(NamedTuple):
    """Who sent on a stream: `unit` is the last word of the key where the key has one, else empty."""

    train: str
    stream: str
    unit: str
    instance: str


@dataclass
class Tally:
    """Counts of a stream of a train."""

    messages: int = 0
    bytes: int = 0
    first_ns: int = 0
    last_ns: int = 0
    units: set[str] = field(default_factory=set)

    def add(self, message: Incoming, unit: str) -> None:
        """Count one message."""
        self.messages += 1
        self.bytes += len(message.payload)
        self.first_ns = min(self.first_ns or message.at_ns, message.at_ns)
        self.last_ns = max(self.last_ns, message.at_ns)
        self.units.add(unit)


@dataclass
class Summary:
    """A recording in figures."""

    files: list[McapReader] = field(default_factory=list)
    streams: dict[tuple[str, str], Tally] = field(default_factory=dict)
    gaps: Gaps = field(default_factory=Gaps)

    def read(self, paths: Iterable[Path], progress: Callable[[int], None] = lambda _: None) -> Summary:
        """Count everything in files. Raises ConfigError."""
        done = 0
        for path in paths:
            reader = McapReader(path)
            self.files.append(reader)
            for number, message in enumerate(reader.messages()):
                self._add(message)
                if number % 1000 == 0:
                    progress(done + reader.read_bytes)
            done += path.stat().st_size
        return self

    def _add(self, message: Incoming) -> None:
        place, row, head = place_of(message.key), row_of(message.key, message.encoding), head_of(message.payload)
        train, stream = place.train if place else "", row.name if row else OTHER
        unit = place.unit if place and row and "{unit}" in row.key else ""
        self.streams.setdefault((train, stream), Tally()).add(message, unit)
        if head.instance is not None:
            self.gaps.note(Sender(train, stream, unit, head.instance), head.sequence)

    @property
    def begin_ns(self) -> int:
        """The first receipt."""
        return min((tally.first_ns for tally in self.streams.values()), default=0)

    @property
    def end_ns(self) -> int:
        """The last receipt."""
        return max((tally.last_ns for tally in self.streams.values()), default=0)

    @property
    def senders(self) -> dict[Sender, Run]:
        """The sequence numbers of every sender."""
        return {sender: run for sender, run in self.gaps.runs.items() if isinstance(sender, Sender)}

    def as_dict(self) -> dict[str, Any]:
        """All of it as JSON has it."""
        missing = {(s.train, s.stream): 0 for s in self.senders}
        for sender, run in self.senders.items():
            missing[sender.train, sender.stream] += run.missing
        return {
            "files": [
                {
                    "file": str(each.path),
                    "bytes": each.path.stat().st_size,
                    "whole": each.whole,
                    "damaged": each.damaged,
                    **each.metadata,
                }
                for each in self.files
            ],
            "trains": sorted({train for train, _ in self.streams if train}),
            "begin_ns": self.begin_ns,
            "end_ns": self.end_ns,
            "span_s": (self.end_ns - self.begin_ns) * 1e-9,
            "messages": sum(tally.messages for tally in self.streams.values()),
            "streams": [
                {
                    "train": train,
                    "stream": stream,
                    "units": sorted(tally.units - {""}),
                    "messages": tally.messages,
                    "bytes": tally.bytes,
                    "begin_ns": tally.first_ns,
                    "end_ns": tally.last_ns,
                    "missing": missing.get((train, stream), 0),
                }
                for (train, stream), tally in sorted(self.streams.items())
            ],
            "senders": [
                {
                    **sender._asdict(),
                    "first": run.first,
                    "last": run.next - 1,
                    "messages": run.came,
                    "repeated": run.repeated,
                    "missing": run.missing,
                    "gaps": [list(gap) for gap in run.gaps],
                }
                for sender, run in sorted(self.senders.items())
            ],
        }
