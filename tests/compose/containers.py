"""The containers of compose.yaml as one project, and what a dispatch tool outside hears of them."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import msgpack
import pytest
import yaml
import zenoh
from engine import ROOT, run

from milepost.chaos.news import News, NotInTime

COMPOSE_FILE = ROOT / "compose.yaml"
SERVICES = sorted(yaml.safe_load(COMPOSE_FILE.read_text(encoding="utf-8"))["services"])
TRAIN = "milepost/v1/full-1"
UNITS = {"odometer-front", "odometer-rear", "radar-front", "radar-rear", "loop", "imu", "gnss"}
EPOCH_NS = 20_000_000
# truths go in the background and are the first to be dropped on a busy machine; this share of the states is enough to compare
COMPARED = 0.5

State = dict[str, Any]


@dataclass
class Listener:
    """What was heard from outside, with the time of receipt."""

    states: list[tuple[float, State]] = field(default_factory=list)
    truths: dict[int, dict[str, Any]] = field(default_factory=dict)
    # process, time of receipt and whether it came or went
    tokens: list[tuple[str, float, bool]] = field(default_factory=list)
    encodings: set[str] = field(default_factory=set)
    newest_truth_ns: int = 0
    news: News = field(default_factory=News)

    def on_state(self, sample: Any) -> None:
        self.states.append((time.monotonic(), msgpack.unpackb(sample.payload.to_bytes())))
        self.encodings.add(str(sample.encoding))
        self.news.heard()

    def on_truth(self, sample: Any) -> None:
        truth = msgpack.unpackb(sample.payload.to_bytes())
        self.truths[truth["measured_at_ns"]] = truth
        self.newest_truth_ns = max(self.newest_truth_ns, truth["measured_at_ns"])
        self.news.heard()

    def on_token(self, sample: Any) -> None:
        process = str(sample.key_expr).split("/")[-2]
        self.tokens.append((process, time.monotonic(), sample.kind == zenoh.SampleKind.PUT))
        self.news.heard()

    def wait(self, condition: Callable[[], bool], within_s: float, what: str) -> None:
        try:
            self.news.wait_for(condition, within_s, what)
        except NotInTime as late:
            last = self.states[-1] if self.states else None
            pytest.fail(f"{late}. Last of {len(self.states)} states: {last}")

    def wait_for_state(self, condition: Callable[[State], bool], within_s: float, what: str, first: int | None = None) -> int:
        """The index of the first state that meets a condition, from index `first` on, or from now on."""
        at = len(self.states) if first is None else first

        def found() -> bool:
            nonlocal at
            while at < len(self.states):
                if condition(self.states[at][1]):
                    return True
                at += 1
            return False

        self.wait(found, within_s, what)
        return at

    def span(self, first: int, epochs: int) -> list[tuple[float, State]]:
        """The states of so many epochs from an index on, when they and the truth for the last have come."""
        end = self.states[first][1]["epoch"] + epochs
        within_s = epochs * EPOCH_NS * 1e-9 + 10.0
        last = self.wait_for_state(lambda state: state["epoch"] >= end, within_s, "the end of the window", first)
        end_ns = self.states[last][1]["measured_at_ns"]
        self.wait(lambda: self.newest_truth_ns >= end_ns, 5.0, "the truth for the last state")
        return self.states[first : last + 1]


@dataclass
class Stack:
    """The containers of one project."""

    compose: list[str]
    project: str
    environment: dict[str, str]
    listener: Listener = field(default_factory=Listener)
    figures: dict[str, float] = field(default_factory=dict)

    def call(self, *arguments: str, timeout_s: float = 120.0) -> str:
        return run([*self.compose, *arguments], timeout_s, self.environment)

    def container(self, service: str) -> str:
        labels = {"project": self.project, "service": service}
        filters = [f"--filter=label=com.docker.compose.{name}={value}" for name, value in labels.items()]
        found = run(["docker", "ps", "-a", "-q", *filters], 30.0).split()
        assert len(found) == 1, f"{service}: containers {found}"
        return found[0]

    def inspect(self, service: str) -> dict[str, Any]:
        found: list[dict[str, Any]] = json.loads(run(["docker", "inspect", self.container(service)], 30.0))
        return found[0]

    def inside(self, service: str, script: str) -> str:
        return run(["docker", "exec", self.container(service), "sh", "-c", script], 30.0)


def units(state: State, name: str) -> list[str]:
    return [entry["unit"] for entry in state[name]]


def is_whole(state: State) -> bool:
    return state["status"] == "normal" and not state["excluded"] and set(units(state, "sensors")) == UNITS


def advancing(heard: list[tuple[float, State]]) -> list[tuple[float, State]]:
    """The states that are newer than all before: a standby that has waited for a leader may say an epoch once more."""
    newest = heard[:1]
    for entry in heard[1:]:
        if entry[1]["epoch"] > newest[-1][1]["epoch"]:
            newest.append(entry)
    return newest


def check_against_truth(stack: Stack, heard: list[tuple[float, State]]) -> None:
    truths = stack.listener.truths
    pairs = [(state, truths[state["measured_at_ns"]]) for _, state in heard if state["measured_at_ns"] in truths]
    stack.figures["states without a truth"] = stack.figures.get("states without a truth", 0.0) + len(heard) - len(pairs)
    assert len(pairs) > COMPARED * len(heard), f"{len(pairs)} truths for {len(heard)} states"
    for state, truth in pairs:
        assert state["position_min_m"] <= truth["position_m"] <= state["position_max_m"], (state, truth)
        assert state["speed_min_mps"] <= truth["speed_mps"] <= state["speed_max_mps"], (state, truth)


def tell(request: pytest.FixtureRequest, stack: Stack) -> None:
    """Show what was measured and, where something failed, what the containers said."""
    reporter = request.config.pluginmanager.get_plugin("terminalreporter")
    capture = request.config.pluginmanager.get_plugin("capturemanager")
    with capture.global_and_fixture_disabled():
        reporter.ensure_newline()
        reporter.write_line("; ".join(f"{name} {value:.3g}" for name, value in stack.figures.items()))
        if request.session.testsfailed:
            reporter.write_line(stack.call("logs", "--no-color", "--tail", "20"))
