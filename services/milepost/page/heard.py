"""What was last heard of each train, decoded only when somebody looks. Bounded, whatever is sent.

Network threads put payloads in, the web server's thread reads. Times are of the receiver's clock, in UTC.
"""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar

from milepost.feeds.fleet import FORGET_NS, MOST_PROCESSES, MOST_TRAINS, NS_PER_S, SAME_RUN_NS
from milepost_schemas import Event, FusedState, Health, Hypotheses, Message, Refused, Truth, decode

# a state that is older is not the train's place any more
SILENT_NS = NS_PER_S
KEPT_EVENTS = 50
# what needs nobody must not push out what does
KEPT_INFOS = 15
# speeds are kept twice a second for five minutes
POINT_EVERY_NS = NS_PER_S // 2
KEPT_POINTS = 600
M = TypeVar("M", bound=Message)


class Raw(NamedTuple):
    """A payload as it came."""

    payload: bytes
    at_ns: int


class Point(NamedTuple):
    """A speed with its bounds, at a time in seconds after the train's first state."""

    at_s: float
    speed_mps: float
    min_mps: float
    max_mps: float


class Told(NamedTuple):
    """An event, and its number among those of its train."""

    number: int
    event: Event


@dataclass
class TrainHeard:
    """One train."""

    name: str
    state: FusedState | None = None
    state_ns: int = 0
    truth: Truth | None = None
    hypotheses: Hypotheses | None = None
    healths: dict[str, Health] = field(default_factory=dict)
    tokens: set[tuple[str, str]] = field(default_factory=set)
    had_tokens: bool = False
    heard_ns: int = 0
    events: deque[Told] = field(default_factory=lambda: deque(maxlen=KEPT_EVENTS))
    infos: deque[Told] = field(default_factory=lambda: deque(maxlen=KEPT_INFOS))
    points: deque[Point] = field(default_factory=lambda: deque(maxlen=KEPT_POINTS))
    # how many points there ever were, and how often they began again
    points_told: int = 0
    runs: int = 0
    raw: dict[str, Raw] = field(default_factory=dict)
    raw_healths: dict[str, Raw] = field(default_factory=dict)
    raw_events: deque[Raw] = field(default_factory=lambda: deque(maxlen=KEPT_EVENTS))
    _events_told: int = 0
    _begun_ns: int = 0

    def age_s(self, now_ns: int) -> float | None:
        """Seconds since the newest state came; None where none did."""
        return None if self.state is None else max(now_ns - self.state_ns, 0) / NS_PER_S

    def status(self, now_ns: int) -> str:
        """The state's status while it is fresh; else `silent`, `ended` or `unknown`."""
        if self.state is not None and now_ns - self.state_ns <= SILENT_NS:
            return self.state.status
        if self.had_tokens and not self.tokens:
            return "ended"
        return "unknown" if self.state is None else "silent"

    def current(self, now_ns: int) -> FusedState | None:
        """The newest state, while it is fresh."""
        return self.state if now_ns - self.state_ns <= SILENT_NS else None

    def all_events(self) -> list[Told]:
        """What was told, oldest first."""
        return sorted([*self.infos, *self.events], key=lambda told: told.number)

    def now_s(self, now_ns: int) -> float | None:
        """The present on the time axis of `points`."""
        if self.state is None:
            return None
        return (self.state.measured_at_ns - self._begun_ns + max(now_ns - self.state_ns, 0)) / NS_PER_S

    def refresh(self) -> None:
        """Decode what has come since."""
        self.truth = self._decoded(self.raw.pop("truth", None), Truth) or self.truth
        self.hypotheses = self._decoded(self.raw.pop("hypotheses", None), Hypotheses) or self.hypotheses
        raw = self.raw.pop("state", None)
        state = self._decoded(raw, FusedState)
        if state is not None and raw is not None:
            self._take(state, raw.at_ns)
        while self.raw_events:
            event = self._decoded(self.raw_events.popleft(), Event)
            if event is not None:
                kept = self.infos if event.severity == "info" else self.events
                kept.append(Told(self._events_told, event))
                self._events_told += 1

    def read_healths(self) -> dict[str, Health]:
        """The newest health of each process."""
        for unit in list(self.raw_healths):
            health = self._decoded(self.raw_healths.pop(unit, None), Health)
            if health is not None and health.unit == unit:
                self.healths[unit] = health
        return self.healths

    def _decoded(self, raw: Raw | None, schema: type[M]) -> M | None:
        if raw is None:
            return None
        try:
            message = decode(raw.payload, schema)
        except Refused:
            return None
        return message if message.train == self.name else None

    def _take(self, state: FusedState, at_ns: int) -> None:
        """Of two fusers that speak at once the first state of an epoch counts; settled ones say nothing new."""
        last = self.state
        if state.settled or (last is not None and at_ns - self.state_ns < SAME_RUN_NS and state.epoch <= last.epoch):
            return
        if last is None or state.measured_at_ns < last.measured_at_ns:
            self.points.clear()
            self._begun_ns, self.runs = state.measured_at_ns, self.runs + 1
        self.state, self.state_ns = state, at_ns
        at_s = (state.measured_at_ns - self._begun_ns) / NS_PER_S
        if not self.points or at_s - self.points[-1].at_s >= POINT_EVERY_NS / NS_PER_S:
            self.points.append(Point(at_s, state.speed_mps, state.speed_min_mps, state.speed_max_mps))
            self.points_told += 1


class Heard:
    """All trains on a router."""

    def __init__(self) -> None:
        self._trains: dict[str, TrainHeard] = {}
        self._lock = threading.Lock()
        self.left_out = 0

    def receive(self, stream: str, train: str, unit: str, payload: bytes, now_ns: int) -> None:
        """Keep what came on a stream of a train; of a health, `unit` is the process."""
        with self._lock:
            heard = self._train(train, now_ns)
            if heard is None:
                return
            raw = Raw(payload, now_ns)
            if stream == "event":
                heard.raw_events.append(raw)
            elif stream != "health":
                heard.raw[stream] = raw
            elif unit in heard.raw_healths or len(heard.healths) + len(heard.raw_healths) < MOST_PROCESSES:
                heard.raw_healths[unit] = raw

    def alive(self, train: str, unit: str, instance: str, there: bool, now_ns: int) -> None:
        """A process's token appeared or went."""
        with self._lock:
            heard = self._train(train, now_ns)
            if heard is None:
                return
            if not there:
                heard.tokens.discard((unit, instance))
            elif len(heard.tokens) < MOST_PROCESSES:
                heard.tokens.add((unit, instance))
                heard.had_tokens = True

    def refresh(self) -> None:
        """Decode the newest of each train."""
        with self._lock:
            for train in self._trains.values():
                train.refresh()

    def trains(self) -> list[TrainHeard]:
        """All trains by name."""
        with self._lock:
            return [train for _, train in sorted(self._trains.items())]

    def train(self, name: str) -> TrainHeard | None:
        """One train, with the health of its processes."""
        with self._lock:
            found = self._trains.get(name)
            if found is not None:
                found.read_healths()
            return found

    def forget(self, now_ns: int) -> None:
        """Forget trains that were silent for long."""
        with self._lock:
            for name, train in list(self._trains.items()):
                if now_ns - train.heard_ns > FORGET_NS and not train.tokens:
                    del self._trains[name]

    def _train(self, name: str, now_ns: int) -> TrainHeard | None:
        train = self._trains.get(name)
        if train is None:
            if len(self._trains) >= MOST_TRAINS:
                self.left_out += 1
                return None
            train = self._trains[name] = TrainHeard(name)
        train.heard_ns = now_ns
        return train
