"""What was last heard of each train, and what was counted since. Bounded, whatever is sent."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from milepost_schemas import EVENT_CODES, Event, FusedState, Health, Message

from .histogram import Histogram

NS_PER_S = 1_000_000_000
# a state that is older is not the train's place any more
STALE_NS = 5 * NS_PER_S
# whoever is silent for so long is forgotten, with what was counted
FORGET_NS = 600 * NS_PER_S
# strangers can send names; what is beyond is left out, and counted
MOST_TRAINS, MOST_PROCESSES, MOST_INSTANCES = 256, 256, 16
# of two fusers that speak at once the first state of an epoch counts; a train that begins again may begin earlier
SAME_RUN_NS = NS_PER_S
# what a train did not say for longer is not missing: it was away
AWAY_NS = 30 * NS_PER_S
LATENCY_S = (0.005, 0.01, 0.015, 0.02, 0.025, 0.03, 0.05, 0.1, 0.2, 0.5, 1.0)
DELIVERY_S = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.5, 1.0)
CODES = {row.code for row in EVENT_CODES}
REFUSED, UNKNOWN = "refused_REASON", "unknown"


@dataclass
class ProcessView:
    """A process: its living instances, how often it was started again, its last health."""

    instances: set[str] = field(default_factory=set)
    seen: deque[str] = field(default_factory=lambda: deque(maxlen=MOST_INSTANCES))
    restarts: int = 0
    health: Health | None = None
    health_ns: int = 0
    heard_ns: int = 0

    def appeared(self, instance: str) -> None:
        """An instance is there: a restart, unless it is the first or was there before."""
        if instance not in self.seen:
            self.restarts += bool(self.seen)
            self.seen.append(instance)


@dataclass
class TrainView:
    """A train: its newest state and when that came, and counts of what came."""

    state: FusedState | None = None
    state_ns: int = 0
    heard_ns: int = 0
    states: int = 0
    missing: int = 0
    incomplete: int = 0
    resets: int = 0
    exclusions: dict[str, int] = field(default_factory=dict)
    events: dict[str, int] = field(default_factory=lambda: dict.fromkeys((*sorted(CODES), UNKNOWN), 0))
    latency: Histogram = field(default_factory=lambda: Histogram(LATENCY_S))
    delivery: Histogram = field(default_factory=lambda: Histogram(DELIVERY_S))
    processes: dict[str, ProcessView] = field(default_factory=dict)

    def current(self, now_ns: int) -> FusedState | None:
        """The newest state, if it is not too old."""
        return self.state if now_ns - self.state_ns <= STALE_NS else None

    def take_state(self, state: FusedState, now_ns: int) -> None:
        """Take a state; a second one of an epoch, and settled ones, say nothing new."""
        last = self.state
        same_run = last is not None and now_ns - self.state_ns < SAME_RUN_NS
        if state.settled or (last is not None and same_run and state.epoch <= last.epoch):
            return
        before = {each.unit for each in last.excluded} if last is not None else set()
        for unit in {each.unit for each in state.excluded} - before:
            self.exclusions[unit] = self.exclusions.get(unit, 0) + 1
        if last is not None and now_ns - self.state_ns < AWAY_NS:
            self.missing += max(state.epoch - last.epoch - 1, 0)
        self.states += 1
        self.incomplete += bool(state.awaiting)
        self.resets += state.reset is not None
        self._observe(state, now_ns)
        self.state, self.state_ns = state, now_ns
        self._keep_units_of(state)

    def _observe(self, state: FusedState, now_ns: int) -> None:
        self.latency.observe((state.published_at_ns - state.measured_at_ns) / NS_PER_S)
        delivered_s = (now_ns - state.published_at_ns) / NS_PER_S
        # scenario time that runs faster than clocks, or a clock that is ahead: no duration
        if delivered_s >= 0.0:
            self.delivery.observe(delivered_s)

    def _keep_units_of(self, state: FusedState) -> None:
        if len(self.exclusions) > MOST_PROCESSES:
            units = {each.unit for each in state.sensors} | {each.unit for each in state.excluded}
            self.exclusions = {unit: count for unit, count in self.exclusions.items() if unit in units}

    def take_event(self, event: Event) -> None:
        """Count an event by its row in the table of events."""
        code = REFUSED if event.code.startswith("refused_") else event.code
        self.events[code if code in CODES else UNKNOWN] += 1


class Fleet:
    """All trains that are heard. Times are of the receiver's clock, in UTC."""

    def __init__(self) -> None:
        self.trains: dict[str, TrainView] = {}
        self.left_out = 0

    def receive(self, message: Message, now_ns: int) -> None:
        """Take a state, a health or an event."""
        train = self._train(message.train, now_ns)
        if train is None:
            return
        if isinstance(message, FusedState):
            train.take_state(message, now_ns)
        elif isinstance(message, Event):
            train.take_event(message)
        elif isinstance(message, Health):
            process = self._process(train, message.unit, now_ns)
            if process is not None:
                process.health, process.health_ns = message, now_ns
                process.appeared(message.instance)

    def alive(self, train_name: str, unit: str, instance: str, there: bool, now_ns: int) -> None:
        """A process's token appeared or went. What has no token left is not shown any more."""
        train = self._train(train_name, now_ns)
        process = None if train is None else self._process(train, unit, now_ns)
        if process is None:
            return
        if not there:
            process.instances.discard(instance)
        elif len(process.instances) < MOST_INSTANCES:
            process.appeared(instance)
            process.instances.add(instance)

    def states(self, now_ns: int) -> list[FusedState]:
        """The newest state of each train that has one, by name."""
        found = (train.current(now_ns) for _, train in sorted(self.trains.items()))
        return [state for state in found if state is not None]

    def forget(self, now_ns: int) -> None:
        """Forget trains, and processes without a token, that were silent for long."""
        for name, train in list(self.trains.items()):
            for unit, process in list(train.processes.items()):
                if not process.instances and now_ns - process.heard_ns > FORGET_NS:
                    del train.processes[unit]
            if not train.processes and now_ns - train.heard_ns > FORGET_NS:
                del self.trains[name]

    def _train(self, name: str, now_ns: int) -> TrainView | None:
        train = self.trains.get(name)
        if train is None:
            if len(self.trains) >= MOST_TRAINS:
                self.left_out += 1
                return None
            train = self.trains[name] = TrainView()
        train.heard_ns = now_ns
        return train

    def _process(self, train: TrainView, unit: str, now_ns: int) -> ProcessView | None:
        process = train.processes.get(unit)
        if process is None:
            if len(train.processes) >= MOST_PROCESSES:
                self.left_out += 1
                return None
            process = train.processes[unit] = ProcessView()
        process.heard_ns = now_ns
        return process
