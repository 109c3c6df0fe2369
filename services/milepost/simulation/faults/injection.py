"""The faults of one unit at work on its readings."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Any

from pydantic import ValidationError

from milepost_schemas import Message

from .content import LONGEST_AGE_S
from .effect import Moment, Sent, Surroundings
from .entry import FaultEntry
from .table import FAULTS

REMEMBERED_NS = round((LONGEST_AGE_S + 1.0) * 1e9)


class _Active:
    """One fault, with how often it has acted and what the last honest reading before it was."""

    def __init__(self, entry: FaultEntry) -> None:
        self.entry = entry
        self._row, self._options = FAULTS[entry.kind], entry.options()
        self._count = 0
        self._onset: Any = None

    def apply(self, reading: Any, t_s: float, earlier: deque[Any], around: Surroundings) -> list[Sent]:
        if self._row.passes_over is not None and self._row.passes_over(self._options, self._count, reading):
            return [Sent(reading)]
        if self._onset is None:
            self._onset = self._before(earlier, t_s)
        entry = self.entry
        now = Moment(t_s, entry.from_s, entry.to_s, self._count, self._onset, earlier, around)
        self._count += 1
        return self._row.effect(self._options, now, reading)

    def _before(self, earlier: deque[Any], t_s: float) -> Any:
        """The last honest reading before the onset; the first one since where there is none."""
        begun_ns = earlier[-1].measured_at_ns - round((t_s - self.entry.from_s) * 1e9)
        return next((e for e in reversed(earlier) if e.measured_at_ns < begun_ns), earlier[-1])


class Injection:
    """The faults of a unit: what is sent in the place of each honest reading. Scenario time 0 is at `start_ns`.

    Faults act by the time at which a reading is true, one after another in the order in which they were begun. Sequence
    numbers count what is sent: what a fault keeps back leaves no gap. Raises ValueError for a fault that does not fit the unit.
    """

    def __init__(self, around: Surroundings, start_ns: int, entries: Iterable[FaultEntry] = ()) -> None:
        self.around = around
        self.start_ns = start_ns
        self._active: list[_Active] = []
        self._earlier: deque[Any] = deque()
        self._kept_back = 0
        for entry in entries:
            self.begin(entry)

    def begin(self, entry: FaultEntry) -> None:
        """Have one more fault. Raises ValueError for one that does not fit the unit."""
        around = self.around
        misfit = entry.misfit(around.stream, around.sensor, around.motion is not None)
        if misfit is not None:
            raise ValueError(misfit)
        self._active.append(_Active(entry))

    def clear(self) -> list[FaultEntry]:
        """End all faults; returns those that were not over."""
        ended = [active.entry for active in self._active]
        self._active = []
        return ended

    def send(self, reading: Message) -> list[Sent]:
        """What is sent in a reading's place. Raises ValidationError if that is beyond what a message can say."""
        if self._kept_back:
            reading = reading.model_copy(update={"sequence": reading.sequence - self._kept_back})
        earlier = self._earlier
        earlier.append(reading)
        while earlier[0].measured_at_ns < reading.measured_at_ns - REMEMBERED_NS:
            earlier.popleft()
        if not self._active:
            return [Sent(reading)]
        t_s = (reading.measured_at_ns - self.start_ns) * 1e-9
        self._active = [active for active in self._active if t_s < active.entry.to_s]
        acting = [active for active in self._active if t_s >= active.entry.from_s]
        if not acting:
            return [Sent(reading)]
        sent = [Sent(reading)]
        for active in acting:
            sent = [
                Sent(out.message, out.delay_s + before.delay_s)
                for before in sent
                for out in active.apply(before.message, t_s, earlier, self.around)
            ]
        try:
            sent = [Sent(type(out.message).model_validate(out.message.model_dump()), out.delay_s) for out in sent]
        except ValidationError:
            self._kept_back += 1
            raise
        if not sent:
            self._kept_back += 1
        return sent
