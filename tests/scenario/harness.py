"""A train on the memory bus on which things go wrong: its own nodes, and faults in the links between them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from milepost.config.roles import ROLES, Setting, processes
from milepost.config.train import Train, load_train
from milepost.estimation.time_units import NS_PER_S
from milepost.nodes.base import Node, Output
from milepost.nodes.faulty import FaultyNode
from milepost.nodes.fuser import FuserNode
from milepost.offline.run import OFFLINE_START_NS, OfflineRun
from milepost.simulation.faults import Fault
from milepost_schemas import Event, Feedback, FusedState, Message, Truth

ROOT = Path(__file__).resolve().parents[2]
MAGLEV = ROOT / "deploy/trains/maglev.yaml"
PERIOD_NS = 20_000_000


def at(t_s: float) -> int:
    """UTC of a scenario time."""
    return OFFLINE_START_NS + round(t_s * NS_PER_S)


def on_its_line(folder: Path, line: dict[str, Any], train: dict[str, Any]) -> Path:
    """Write a line file and the file of a train on it; returns the train's."""
    for name, content in (("line", line), ("train", train | {"line": "line.yaml"})):
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return folder / "train.yaml"


def scenario_s(message: Message) -> float:
    """The scenario time at which a message's content was true."""
    return (message.measured_at_ns - OFFLINE_START_NS) / NS_PER_S


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
        nodes.append(node if fault is None else FaultyNode(node, fault, OFFLINE_START_NS))
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
    """How wide the accuracy without faults is; the protected interval follows the worst hypothesis instead."""
    return [2.0 * state.position_accuracy_m for state in states]
