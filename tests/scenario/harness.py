"""A train on the memory bus on which things go wrong: its own nodes, and faults in the links between them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from milepost.config.roles import ROLES, Setting, processes
from milepost.config.train import Train, load_train
from milepost.estimation.time_units import NS_PER_S
from milepost.nodes.base import Node, Output
from milepost.nodes.fuser import FuserNode
from milepost.offline.run import OFFLINE_START_NS, OfflineRun
from milepost_schemas import Event, Feedback, FusedState, Message, Truth

ROOT = Path(__file__).resolve().parents[2]
MAGLEV = ROOT / "deploy/trains/maglev.yaml"
PERIOD_NS = 20_000_000

# what a link does to a message sent at a scenario time: seconds of delay, None for lost
Fault = Callable[[float, Message], float | None]


def at(t_s: float) -> int:
    """UTC of a scenario time."""
    return OFFLINE_START_NS + round(t_s * NS_PER_S)


def scenario_s(message: Message) -> float:
    """The scenario time at which a message's content was true."""
    return (message.measured_at_ns - OFFLINE_START_NS) / NS_PER_S


def silent(from_s: float, to_s: float) -> Fault:
    """Nothing gets through from one time to another."""
    return lambda t_s, message: None if from_s <= t_s < to_s else 0.0


def delayed(seconds: float, from_s: float = 0.0, to_s: float = float("inf")) -> Fault:
    """Everything sent from one time to another comes later."""
    return lambda t_s, message: seconds if from_s <= t_s < to_s else 0.0


class Link(Node):
    """A node whose messages pass a fault before anybody hears them."""

    def __init__(self, inner: Node, fault: Fault) -> None:
        super().__init__(inner.train, inner.unit, inner.instance)
        self.inner = inner
        self.subscriptions = inner.subscriptions
        self._fault = fault
        self._held: list[tuple[int, int, Output]] = []
        self._count = 0

    def step(self, message: Message, now_ns: int) -> Iterable[Output]:
        return self._pass(self.inner.step(message, now_ns), now_ns)

    def tick(self, now_ns: int) -> Iterable[Output]:
        due = self.inner.next_tick_ns()
        passed = self._pass(self.inner.tick(now_ns), now_ns) if due is not None and due <= now_ns else []
        ready = sorted(held for held in self._held if held[0] <= now_ns)
        self._held = [held for held in self._held if held[0] > now_ns]
        return [*[output for _, _, output in ready], *passed]

    def next_tick_ns(self) -> int | None:
        due = [held[0] for held in self._held]
        inner = self.inner.next_tick_ns()
        return min([*due, inner] if inner is not None else due, default=None)

    def _pass(self, outputs: Iterable[Output], now_ns: int) -> list[Output]:
        passed = []
        for output in outputs:
            delay_s = self._fault((now_ns - OFFLINE_START_NS) / NS_PER_S, output.message)
            if delay_s == 0.0:
                passed.append(output)
            elif delay_s is not None:
                self._held.append((now_ns + round(delay_s * NS_PER_S), self._count, output))
                self._count += 1
        return passed


@dataclass
class Journey:
    """What was said on the way: live and settled states and the truth by epoch, and everything else of interest."""

    train: Train
    live: dict[int, FusedState] = field(default_factory=dict)
    settled: dict[int, FusedState] = field(default_factory=dict)
    truth: dict[int, Truth] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)
    feedbacks: int = 0
    nodes: dict[str, Node] = field(default_factory=dict)

    def tap(self, output: Output, now_ns: int) -> None:
        message = output.message
        if isinstance(message, FusedState):
            assert message.measured_at_ns not in self.live, "an epoch was sent twice"
            self.live[message.measured_at_ns] = message
        elif isinstance(message, Truth):
            self.truth[message.measured_at_ns] = message
        elif isinstance(message, Event):
            self.events.append(message)
        elif isinstance(message, Feedback):
            self.feedbacks += 1

    def keep(self, state: FusedState) -> None:
        self.settled[state.measured_at_ns] = state

    def between(self, from_s: float, to_s: float) -> list[FusedState]:
        """The live states of the epochs in [from, to)."""
        return [state for ns, state in self.live.items() if at(from_s) <= ns < at(to_s)]

    def settled_bytes(self) -> list[str]:
        """The settled states, to be compared bit for bit."""
        return [state.model_dump_json() for state in self.settled.values()]

    def outside(self) -> list[tuple[float, str]]:
        """The scenario times at which a state, live or settled, does not hold the truth in its intervals."""
        out = []
        for name, states in (("live", self.live), ("settled", self.settled)):
            for ns, s in states.items():
                truth = self.truth.get(ns)
                if truth is None:
                    continue
                if not s.position_min_m <= truth.position_m <= s.position_max_m:
                    out.append((scenario_s(s), f"{name} position"))
                if not s.speed_min_mps <= truth.speed_mps <= s.speed_max_mps:
                    out.append((scenario_s(s), f"{name} speed"))
        return out

    @property
    def fuser(self) -> FuserNode:
        node = self.nodes["fuser"]
        assert isinstance(node, FuserNode)
        return node


def travel(
    duration_s: float,
    faults: Mapping[str, Fault] | None = None,
    change: Mapping[str, Any] | None = None,
    happening: Iterable[tuple[float, Output | Callable[[Journey], None]]] = (),
    train_file: Path = MAGLEV,
) -> Journey:
    """Run a train's own nodes for a while.

    `faults`: process name → what happens to its messages. `happening`: (when, a message from elsewhere, or what to do).
    """
    train = load_train(train_file, change)
    setting = Setting("offline", train.world(duration_s), OFFLINE_START_NS)
    journey, nodes = Journey(train), []
    left = dict(faults or {})
    for process in processes(train):
        node = ROLES[process.role].build(train, process.unit, setting)
        journey.nodes[process.name] = node
        fault = left.pop(process.name, None)
        nodes.append(node if fault is None else Link(node, fault))
    assert not left, f"no such process: {', '.join(left)}"
    run = OfflineRun(train, nodes, journey.tap, journey.keep)
    for when_s, what in sorted(happening, key=lambda entry: entry[0]):
        run.bus.run_until(at(when_s))
        if isinstance(what, Output):
            run.bus.inject(what.stream, what.unit, what.message, at(when_s))
        else:
            what(journey)
    run.bus.run_until(at(duration_s) + 1)
    run.finish()
    return journey


def widths(states: Iterable[FusedState]) -> list[float]:
    """How wide the position intervals are."""
    return [state.position_max_m - state.position_min_m for state in states]
