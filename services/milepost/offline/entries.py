"""The formats of recorded messages: one entry after the other, whatever the file.

JSON Lines   one {"key", "received_at_ns", "payload"} a line
MCAP         what `milepost run recorder` writes
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from milepost.recorder.library import need_mcap
from milepost_schemas import Refused, unpack

MCAP_MAGIC = b"\x89MCAP0\r\n"


class Entry(NamedTuple):
    """A recorded message: `fields` decodes its payload, and raises Refused where it cannot."""

    key: str
    received_at_ns: int | None
    fields: Callable[[], object]
    encoding: str = ""


class Source(Protocol):
    """A file of recorded messages. `noun`: what an entry of it is called.

    `fingerprint`: of the settings with which the train ran, once it has been read; empty where the file does not say.
    `cut_off`: whether its end is missing and nothing else is wrong, once it has been read.
    """

    path: Path
    noun: str
    read_bytes: int
    fingerprint: str
    cut_off: bool

    def entries(self) -> Iterator[tuple[int, Entry | Refused]]:
        """Each entry's number, from 1, and the entry, or why it is none."""


def sources_in(path: Path) -> list[Source]:
    """The files of a recording. Raises ConfigError, OSError."""
    if not path.is_dir() and not _is_mcap(path):
        return [JsonLines(path)]
    need_mcap(str(path))
    from milepost.recorder.reading import recordings_in

    return [McapFile(file) for file in recordings_in(path)]


def _is_mcap(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(MCAP_MAGIC)) == MCAP_MAGIC


@dataclass
class JsonLines:
    """A file with a message a line."""

    path: Path
    read_bytes: int = 0
    noun: str = "line"
    fingerprint: str = ""
    # a last line that is not whole is refused
    cut_off: bool = False

    def entries(self) -> Iterator[tuple[int, Entry | Refused]]:
        """Each line that is not empty."""
        with self.path.open("rb") as file:
            for number, line in enumerate(file, start=1):
                self.read_bytes += len(line)
                if line.strip():
                    yield number, _parsed(line)


def _parsed(line: bytes) -> Entry | Refused:
    try:
        found: Any = json.loads(line)
    except (ValueError, RecursionError) as error:
        return Refused("undecodable", f"not JSON: {error}")
    key = found.get("key") if isinstance(found, dict) else None
    if not isinstance(key, str):
        return Refused("invalid", "key: must be a string")
    received = found.get("received_at_ns")
    if received is not None and (type(received) is not int or received <= 0):
        return Refused("invalid", "received_at_ns: must be a positive whole number")
    return Entry(key, received, lambda: found.get("payload"))


@dataclass
class McapFile:
    """A recorder's file, also one that was cut off."""

    path: Path
    read_bytes: int = 0
    noun: str = "message"
    fingerprint: str = ""
    cut_off: bool = False

    def __post_init__(self) -> None:
        self.noun = f"{self.path.name}: message"

    def entries(self) -> Iterator[tuple[int, Entry | Refused]]:
        """Each message, received at the time that the train's processes went by."""
        from milepost.recorder.reading import McapReader
        from milepost.recorder.scenario_clock import MADE_OF, ScenarioClock

        reader = McapReader(self.path)
        metadata = reader.read_metadata()
        clock, self.fingerprint = ScenarioClock.of(metadata), metadata.get(MADE_OF, {}).get("fingerprint", "")
        for number, message in enumerate(reader.messages(), start=1):
            self.read_bytes = reader.read_bytes
            yield (
                number,
                Entry(message.key, clock.at(message.at_ns), partial(unpack, message.payload), message.encoding),
            )
        self.read_bytes, self.cut_off = reader.read_bytes, reader.cut_off
        for number, damage in enumerate(reader.damaged, start=1):
            yield number, Refused("damaged", damage)
