"""Recorded messages for a rerun, from JSON Lines or MCAP, in order of arrival."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

from milepost.config.train import Train
from milepost.nodes.base import Output, Refusals
from milepost.recorder.rows import MSGPACK, place_of, rows_of
from milepost_schemas import BY_NAME, ROOT, Message, Refused, from_fields

from .entries import Entry, Source, sources_in

# a receipt time farther off than this is wrong; a rerun would pass through the time between epoch by epoch
FARTHEST_NS = 3600 * 10**9


def write_line(file: TextIO, train: str, output: Output, received_at_ns: int) -> None:
    """Append one message."""
    key = BY_NAME[output.stream].key_for(train, output.unit)
    line = {"key": key, "received_at_ns": received_at_ns, "payload": output.message.model_dump()}
    file.write(json.dumps(line, separators=(",", ":")) + "\n")


@dataclass
class Reader:
    """Reads a recording for a train; refused messages are counted by reason, and `first` has the first one of each.

    `path`: a file, or a folder of MCAP files.
    """

    path: Path
    train: Train
    kinds: tuple[str, ...]
    refusals: Refusals = field(default_factory=Refusals)
    first: dict[str, str] = field(default_factory=dict)
    sources: list[Source] = field(init=False)

    def __post_init__(self) -> None:
        self.sources = sources_in(self.path)

    @property
    def size(self) -> int:
        """The bytes of all files."""
        return sum(source.path.stat().st_size for source in self.sources)

    @property
    def read_bytes(self) -> int:
        """How much has been read."""
        return sum(source.read_bytes for source in self.sources)

    def made_otherwise(self, fingerprint: str) -> list[Path]:
        """The files whose train ran with other settings or another version, among those that say so and have been read."""
        return [source.path for source in self.sources if source.fingerprint not in ("", fingerprint)]

    def cut_off(self) -> list[Path]:
        """The files whose end is missing, among those that have been read."""
        return [source.path for source in self.sources if source.cut_off]

    def messages(self) -> Iterator[tuple[str, str, Message, int]]:
        """(stream, unit, message, received_at_ns) of every message of the wanted kinds ("reading", "estimate", "fix")."""
        latest_ns = 0
        for source in self.sources:
            for number, entry in source.entries():
                try:
                    if isinstance(entry, Refused):
                        raise entry
                    found = self._message(entry)
                except Refused as refused:
                    if self.refusals.add(refused.reason):
                        self.first[refused.reason] = f"{source.noun} {number}: {refused.detail}"
                    continue
                if found is None:
                    continue
                stream, unit, message, received = found
                # without a receipt time, the latest publication time so far is the clock
                latest_ns = max(latest_ns, message.published_at_ns)
                yield stream, unit, message, received if received is not None else latest_ns

    def _message(self, entry: Entry) -> tuple[str, str, Message, int | None] | None:
        place = place_of(entry.key)
        if place is None:
            raise Refused("invalid", f"key: {entry.key} is not below {ROOT}/TRAIN/")
        if place.path.split("/")[0] not in self.kinds:
            return None
        if place.train != self.train.name:
            raise Refused("other_train", f"{place.train} is not {self.train.name}")
        stream, unit = self._stream(place.path)
        schema, received = BY_NAME[stream].message, entry.received_at_ns
        if entry.encoding.startswith(f"{MSGPACK};") and entry.encoding != schema.encoding():
            raise Refused("other_schema", f"{entry.key}: {entry.encoding}, expected {schema.encoding()}")
        message: Message = from_fields(entry.fields(), schema)
        if received is not None and abs(received - message.published_at_ns) > FARTHEST_NS:
            raise Refused("invalid", "received_at_ns: must be within an hour of published_at_ns")
        if message.train != self.train.name:
            raise Refused("other_train", f"{message.train} is not {self.train.name}")
        if unit and message.unit != unit:
            raise Refused("other_unit", f"{entry.key}: the payload's unit is {message.unit}")
        return stream, unit, message, received

    def _stream(self, path: str) -> tuple[str, str]:
        """The stream and the unit of a key, from its part after the train."""
        rows, last = rows_of(path), path.rpartition("/")[2]
        if not rows:
            raise Refused("invalid", f"key: {path} is not in the stream table")
        unit = last if "{unit}" in rows[0].key else ""
        if len(rows) == 1:
            return rows[0].name, unit
        # the readings share a key: the train file says which sensor the unit is
        sensor = self.train.sensors.get(unit)
        if sensor is None:
            raise Refused("unknown_unit", f"{unit} is not in {self.train.path}")
        return sensor.stream, unit
