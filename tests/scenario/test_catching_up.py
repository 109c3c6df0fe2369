"""A fuser that is replaced in mid-run takes over what its replica knows: from then on both settle to the same bits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import pytest
from harness import ROOT, at
from pydantic import TypeAdapter

from milepost.config.roles import ROLES, Setting
from milepost.config.train import Train, load_train
from milepost.nodes.base import Output
from milepost.nodes.fuser import FuserNode
from milepost.offline.run import simulate
from milepost.simulation.faults import FaultEntry
from milepost_schemas import Event, Feedback, FusedState, Message, SnapshotPart, decode, encode

END_S = 14.0
# a radar that lies is excluded within a second; before a readmitted unit's probation is over, both know of it
LIE: dict[str, Any] = {"unit": "radar-front", "kind": "bias", "size": 1.5, "from_s": 6.0}
# so long before the snapshot the restarted one began to listen: what came then reaches it twice
HEARD_AGAIN_S = 0.1


@cache
def inbox(name: str, **fault: Any) -> tuple[Train, list[tuple[int, Message]]]:
    """What a train's fuser received, and when."""
    train = load_train(ROOT / f"deploy/trains/{name}.yaml")
    heard: list[tuple[int, Message]] = []

    def tap(output: Output, now_ns: int) -> None:
        if output.stream in ("estimate", "fix"):
            heard.append((now_ns, output.message))

    faults = [TypeAdapter(FaultEntry).validate_python(fault)] if fault else []
    simulate(train, END_S, tap, faults=faults)
    return train, heard


@dataclass
class Heard:
    """A fuser, and what it said."""

    node: FuserNode
    settled: dict[int, str] = field(default_factory=dict)
    live: dict[int, FusedState] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)

    def step(self, message: Message | None, now_ns: int) -> None:
        """The ticks that are due, and a message."""
        while (due_ns := self.node.next_tick_ns()) is not None and due_ns < now_ns:
            self._settle(due_ns)
            self._note(self.node.tick(due_ns))
        self._settle(now_ns)
        if message is not None:
            self._note(self.node.step(message, now_ns))

    def _settle(self, now_ns: int) -> None:
        for state in self.node.settled_states(now_ns):
            self.settled[state.measured_at_ns] = state.model_dump_json()

    def _note(self, outputs: Any) -> None:
        for output in outputs:
            if isinstance(output.message, FusedState):
                assert output.message.measured_at_ns not in self.live, "an epoch comes twice"
                self.live[output.message.measured_at_ns] = output.message
            elif isinstance(output.message, Event):
                self.events.append(output.message)

    def finish(self) -> None:
        for state in self.node.settled_states(None):
            self.settled[state.measured_at_ns] = state.model_dump_json()


def fuser(train: Train, instance: str) -> Heard:
    node = ROLES["fuser"].build(train, "fuser", Setting(instance))
    assert isinstance(node, FuserNode)
    return Heard(node)


def travelled(parts: Iterator[SnapshotPart]) -> list[SnapshotPart]:
    """The parts as they come out of the network, in another order."""
    return [decode(encode(part), SnapshotPart) for part in parts][::-1]


def told(messages: list[tuple[int, Message]], heard: Heard, from_ns: int, to_ns: int) -> None:
    for now_ns, message in messages:
        if from_ns <= now_ns < to_ns:
            heard.step(message, now_ns)


def replaced(train: Train, messages: list[tuple[int, Message]], when_s: float) -> tuple[Heard, Heard]:
    """A fuser that hears everything, and one that begins in mid-run with all that the other one knows by then."""
    first, second = fuser(train, "a"), fuser(train, "b")
    when = at(when_s)
    told(messages, first, 0, when)
    first.step(None, when)
    parts = travelled(first.node.hand_over(when))
    agreed = first.node.answer("latest_feedback")
    assert isinstance(agreed, Feedback)
    second.node.take_over(parts, agreed, when)
    for now_ns, message in messages:
        if at(when_s - HEARD_AGAIN_S) <= now_ns < when:
            second.step(message, when)
    told(messages, second, when, at(END_S) + 1)
    told(messages, first, when, at(END_S) + 1)
    for heard in (first, second):
        heard.finish()
    return first, second


CASES = [
    pytest.param("full", 9.0, LIE, id="a liar is excluded"),
    pytest.param("full", 6.08, LIE, id="the lie has begun"),
    pytest.param("full", 9.0, {"unit": "gnss", "kind": "jump", "size": 40.0, "from_s": 6.0}, id="the receiver is excluded"),
    pytest.param("full", 9.0, {"unit": "odometer-front", "kind": "stuck", "from_s": 6.0}, id="a wheel is stuck"),
    pytest.param("maglev", 0.6, {}, id="just begun"),
    pytest.param("metro", 9.0, {"unit": "radar-1", "kind": "bias", "size": 1.0, "from_s": 6.0}, id="a radar of a metro"),
    pytest.param("gnss-ins", 9.0, {}, id="satellites and an inertial unit that learns"),
]


@pytest.mark.parametrize(("name", "when_s", "fault"), CASES)
def test_a_fuser_that_took_over_settles_to_the_same_bits(name: str, when_s: float, fault: dict[str, Any]) -> None:
    train, messages = inbox(name, **fault)
    first, second = replaced(train, messages, when_s)
    assert len(second.settled) > (END_S - when_s) * 1e9 / train.file.fusion.period_ms / 1e6
    assert {ns: first.settled[ns] for ns in second.settled} == second.settled
    after = {ns: state for ns, state in second.live.items() if ns > at(when_s + HEARD_AGAIN_S)}
    assert after
    for ns, state in after.items():
        assert state.excluded == first.live[ns].excluded
        assert state.doubted == first.live[ns].doubted
        assert state.covariance == first.live[ns].covariance


@pytest.mark.parametrize("when_s", [6.08, 9.0])
def test_no_decision_is_told_again(when_s: float) -> None:
    first, second = replaced(*inbox("full", **LIE), when_s)
    decided = [(e.code, e.text) for e in first.events if e.measured_at_ns > at(when_s) and not e.code.startswith("refused")]
    again = [(e.code, e.text) for e in second.events if not e.code.startswith("refused")]
    assert again == decided
    assert any(code == "unit_excluded" for code, _ in decided) == (when_s < 7.0)


def undecided(states: dict[int, FusedState]) -> list[int]:
    return [ns for ns, state in states.items() if state.doubted]


def test_a_fuser_that_took_over_in_mid_doubt_settles_to_the_same_bits() -> None:
    """Two sources of speed of which one drifts slowly: until the next balise nothing tells which."""
    fault = {"unit": "loop", "kind": "ramp", "rate": 0.05, "from_s": 6.0}
    train, messages = inbox("maglev", **fault)
    watched = fuser(train, "w")
    told(messages, watched, 0, at(END_S))
    doubted = undecided(watched.live)
    assert doubted, "nothing is in doubt: the test proves nothing"
    when_ns = doubted[len(doubted) // 3]
    first, second = replaced(train, messages, (when_ns - at(0.0)) / 1e9)
    assert min(ns for ns in undecided(second.live) if ns > when_ns) in undecided(first.live)
    assert {ns: first.settled[ns] for ns in second.settled} == second.settled
