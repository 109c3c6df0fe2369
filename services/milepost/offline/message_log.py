"""Recorded messages: one {"key", "received_at_ns", "payload"} a line, in order of arrival."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

from milepost.config.train import Train
from milepost.nodes.base import Output, Refusals
from milepost_schemas import BY_NAME, ROOT, STREAMS, Message, Refused, from_fields

# a receipt time farther off than this is wrong; a rerun would pass through the time between epoch by epoch
FARTHEST_NS = 3600 * 10**9


def write_line(file: TextIO, train: str, output: Output, received_at_ns: int) -> None:
    """Append one message."""
    key = BY_NAME[output.stream].key_for(train, output.unit)
    line = {"key": key, "received_at_ns": received_at_ns, "payload": output.message.model_dump()}
    file.write(json.dumps(line, separators=(",", ":")) + "\n")


@dataclass
class Reader:
    """Reads a recording for a train; refused lines are counted by reason, and `first` has the first one of each."""

    path: Path
    train: Train
    kinds: tuple[str, ...]
    refusals: Refusals = field(default_factory=Refusals)
    first: dict[str, str] = field(default_factory=dict)
    read_bytes: int = 0

    def messages(self) -> Iterator[tuple[str, str, Message, int]]:
        """(stream, unit, message, received_at_ns) of every line of the wanted kinds ("reading", "estimate", "fix")."""
        latest_ns = 0
        with self.path.open("rb") as file:
            for number, line in enumerate(file, start=1):
                self.read_bytes += len(line)
                if not line.strip():
                    continue
                try:
                    found = self._message(line)
                except Refused as refused:
                    if self.refusals.add(refused.reason):
                        self.first[refused.reason] = f"line {number}: {refused.detail}"
                    continue
                if found is None:
                    continue
                stream, unit, message, received = found
                # without a receipt time, the latest publication time so far is the clock
                latest_ns = max(latest_ns, message.published_at_ns)
                yield stream, unit, message, received if received is not None else latest_ns

    def _message(self, line: bytes) -> tuple[str, str, Message, int | None] | None:
        try:
            entry: Any = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise Refused("undecodable", f"not JSON: {error}") from error
        key = entry.get("key") if isinstance(entry, dict) else None
        if not isinstance(key, str):
            raise Refused("invalid", "key: must be a string")
        parts = key.split("/")
        if "/".join(parts[:2]) != ROOT or len(parts) < 4:
            raise Refused("invalid", f"key: {key} is not below {ROOT}/TRAIN/")
        if parts[3] not in self.kinds:
            return None
        if parts[2] != self.train.name:
            raise Refused("other_train", f"{parts[2]} is not {self.train.name}")
        stream, unit = self._stream("/".join(parts[3:]))
        received = entry.get("received_at_ns")
        if received is not None and (type(received) is not int or received <= 0):
            raise Refused("invalid", "received_at_ns: must be a positive whole number")
        message = from_fields(entry.get("payload"), BY_NAME[stream].message)
        if received is not None and abs(received - message.published_at_ns) > FARTHEST_NS:
            raise Refused("invalid", "received_at_ns: must be within an hour of published_at_ns")
        if message.train != self.train.name:
            raise Refused("other_train", f"{message.train} is not {self.train.name}")
        if unit and message.unit != unit:
            raise Refused("other_unit", f"{key}: the payload's unit is {message.unit}")
        return stream, unit, message, received

    def _stream(self, path: str) -> tuple[str, str]:
        """The stream and the unit of a key, from its part after the train."""
        last = path.rpartition("/")[2]
        rows = [row for row in STREAMS if row.key.format(unit=last) == path]
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
