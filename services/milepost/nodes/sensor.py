"""A sensor's process: it publishes readings when they are ready."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pydantic import ValidationError

from milepost.estimation.time_units import NS_PER_S
from milepost.recordings.measured import Measured, Source
from milepost.sensors.base import Sensor
from milepost_schemas import BY_NAME

from .base import Node, Output


class SensorNode(Node):
    """Publishes the readings of its source. `start_ns` is the UTC time of scenario time 0."""

    def __init__(self, train: str, instance: str, sensor: Sensor[Any], source: Source, start_ns: int) -> None:
        super().__init__(train, sensor.unit, instance)
        self._stream = sensor.stream
        self._message = BY_NAME[sensor.stream].message
        self._source = source
        self._source_skips: dict[str, int] = getattr(source, "skipped", {})
        self._start_ns = start_ns
        self._withheld = [(span[0], span[1]) for span in sensor.options.withhold_s]
        self._next_ns = self._ready_ns()

    def _ready_ns(self) -> int | None:
        ready = self._source.next_s()
        return None if ready is None else self._start_ns + round(ready * NS_PER_S)

    def next_tick_ns(self) -> int | None:
        """When the next reading is ready."""
        return self._next_ns

    def tick(self, now_ns: int) -> Iterable[Output]:
        """All readings that are ready by now."""
        out: list[Output] = []
        while self._next_ns is not None and self._next_ns <= now_ns:
            measured = self._source.read()
            self._next_ns = self._ready_ns()
            if measured is None or (self._withheld and any(a <= measured.measured_s < b for a, b in self._withheld)):
                continue
            out += self._reading(measured, now_ns)
        out += self._skipped(now_ns)
        self.finished = self._next_ns is None
        return out

    def _reading(self, measured: Measured, now_ns: int) -> Iterable[Output]:
        at = self._start_ns + round(measured.measured_s * NS_PER_S)
        try:
            message = self._message(**self.head(self._stream, at, now_ns), **measured.fields)
        except ValidationError as error:
            self._sequences[self._stream] -= 1
            first = error.errors(include_url=False)[0]
            text = f"{self.unit}: {'.'.join(map(str, first['loc']))}: {first['msg']}"
            return self.refuse("invalid_reading", text, now_ns)
        return (Output(self._stream, self.unit, message),)

    def _skipped(self, now_ns: int) -> Iterable[Output]:
        """Count the entries that the source skipped, and report the first for each reason."""
        for reason, count in self._source_skips.items():
            reported = self.refusals.counts.get(reason, 0)
            if count > reported:
                if not reported:
                    text = getattr(self._source, "told", {}).get(reason, f"{self.unit}: {reason}")
                    yield self.event("warning", f"refused_{reason}", text, now_ns)
                self.refusals.counts[reason] = count
