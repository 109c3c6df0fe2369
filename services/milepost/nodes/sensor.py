"""A sensor's process: its readings, when they are ready."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from milepost.sensors.base import Sensor, Source
from milepost_schemas import BY_NAME

from .base import Node, Output

NS = 1_000_000_000


class SensorNode(Node):
    """Publishes what its source measures. `start_ns` is the UTC time of scenario time 0."""

    def __init__(self, train: str, instance: str, sensor: Sensor[Any], source: Source, start_ns: int) -> None:
        super().__init__(train, sensor.unit, instance)
        self._stream = sensor.stream
        self._message = BY_NAME[sensor.stream].message
        self._source = source
        self._start_ns = start_ns
        self._withheld = [(span[0], span[1]) for span in sensor.options.withhold_s]
        self._next_ns = self._ready_ns()

    def _ready_ns(self) -> int | None:
        ready = self._source.next_s()
        return None if ready is None else self._start_ns + round(ready * NS)

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
            at = self._start_ns + round(measured.measured_s * NS)
            out.append(Output(self._stream, self.unit, self._message(**self.head(self._stream, at, now_ns), **measured.fields)))
        self.finished = self._next_ns is None
        return out
