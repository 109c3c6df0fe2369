"""compose.yaml brought up for real and looked at from outside, as a dispatch tool would: only eclipse-zenoh and msgpack."""

from __future__ import annotations

import json
import os
import statistics
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import msgpack
import pytest
import yaml
import zenoh
from engine import ROOT, find_compose, free_port, run, wait_until_healthy

pytestmark = pytest.mark.compose

COMPOSE_FILE = ROOT / "compose.yaml"
SERVICES = sorted(yaml.safe_load(COMPOSE_FILE.read_text(encoding="utf-8"))["services"])
TRAIN = "milepost/v1/full-1"
UNITS = {"odometer-front", "odometer-rear", "radar-front", "radar-rear", "loop", "imu", "gnss"}
EPOCH_NS = 20_000_000
# without a token's word, a unit's silence is noticed after one second
SILENCE_S = 1.0
# what a dispatch tool may count on, and of which type
FIELDS: dict[str, type | tuple[type, ...]] = {
    "train": str,
    "unit": str,
    "instance": str,
    "sequence": int,
    "measured_at_ns": int,
    "published_at_ns": int,
    "epoch": int,
    "position_m": float,
    "speed_mps": float,
    "acceleration_mps2": float,
    "covariance": list,
    "position_min_m": float,
    "position_max_m": float,
    "speed_min_mps": float,
    "speed_max_mps": float,
    "direction": str,
    "status": str,
    "line": str,
    "line_hash": str,
    "last_balise": (dict, type(None)),
    "sensors": list,
    "excluded": list,
    "awaiting": list,
    "settled": bool,
}

State = dict[str, Any]


@dataclass
class Listener:
    """What was heard from outside, with the time of receipt."""

    states: list[tuple[float, State]] = field(default_factory=list)
    truths: dict[int, dict[str, Any]] = field(default_factory=dict)
    # process, time of receipt and whether it came or went
    tokens: list[tuple[str, float, bool]] = field(default_factory=list)
    encodings: set[str] = field(default_factory=set)
    news: threading.Condition = field(default_factory=threading.Condition)

    def on_state(self, sample: Any) -> None:
        with self.news:
            self.states.append((time.monotonic(), msgpack.unpackb(sample.payload.to_bytes())))
            self.encodings.add(str(sample.encoding))
            self.news.notify_all()

    def on_truth(self, sample: Any) -> None:
        truth = msgpack.unpackb(sample.payload.to_bytes())
        with self.news:
            self.truths[truth["measured_at_ns"]] = truth
            self.news.notify_all()

    def on_token(self, sample: Any) -> None:
        process = str(sample.key_expr).split("/")[-2]
        with self.news:
            self.tokens.append((process, time.monotonic(), sample.kind == zenoh.SampleKind.PUT))
            self.news.notify_all()

    def wait(self, condition: Callable[[], bool], within_s: float, what: str) -> None:
        with self.news:
            if not self.news.wait_for(condition, within_s):
                last = self.states[-1] if self.states else None
                pytest.fail(f"not within {within_s:g} s: {what}. Last of {len(self.states)} states: {last}")

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
        self.wait(lambda: max(self.truths, default=0) >= end_ns, 5.0, "the truth for the last state")
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


@pytest.fixture(scope="module")
def stack(request: pytest.FixtureRequest) -> Iterator[Stack]:
    tool, port = find_compose(), free_port()
    project = f"milepost-test-{os.getpid()}"
    stack = Stack(
        [*tool, "-f", str(COMPOSE_FILE), "-p", project],
        project,
        {**os.environ, "MILEPOST_PORT": str(port), "MILEPOST_PORT_2": str(free_port())},
    )
    config = {
        "mode": "client",
        "connect": {"endpoints": [f"tcp/127.0.0.1:{port}"], "timeout_ms": 30000, "exit_on_failure": True},
        "scouting": {"multicast": {"enabled": False}},
    }
    listener, figures = stack.listener, stack.figures
    try:
        begun = time.monotonic()
        stack.call("build", timeout_s=900.0)
        figures["image built in s"] = time.monotonic() - begun
        begun = time.monotonic()
        stack.call("up", "-d")
        figures["`up -d` returned after s"] = time.monotonic() - begun
        with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
            kept = [
                session.declare_subscriber(f"{TRAIN}/state", listener.on_state),
                session.declare_subscriber(f"{TRAIN}/@sim/truth", listener.on_truth),
                session.liveliness().declare_subscriber(f"{TRAIN}/alive/*/*", listener.on_token, history=True),
            ]
            listener.wait(lambda: bool(listener.states), 60.0, "a first state")
            figures["first state after s"] = listener.states[0][0] - begun
            yield stack
            del kept
    finally:
        tell(request, stack)
        stack.call("down", "--volumes", "--remove-orphans", "--timeout", "5")


def tell(request: pytest.FixtureRequest, stack: Stack) -> None:
    """Show what was measured and, where something failed, what the containers said."""
    reporter = request.config.pluginmanager.get_plugin("terminalreporter")
    capture = request.config.pluginmanager.get_plugin("capturemanager")
    with capture.global_and_fixture_disabled():
        reporter.ensure_newline()
        reporter.write_line("; ".join(f"{name} {value:.3g}" for name, value in stack.figures.items()))
        if request.session.testsfailed:
            reporter.write_line(stack.call("logs", "--no-color", "--tail", "20"))


def units(state: State, name: str) -> list[str]:
    return [entry["unit"] for entry in state[name]]


def is_whole(state: State) -> bool:
    return state["status"] == "normal" and not state["excluded"] and set(units(state, "sensors")) == UNITS


def check_against_truth(stack: Stack, heard: list[tuple[float, State]]) -> None:
    truths = stack.listener.truths
    pairs = [(state, truths[state["measured_at_ns"]]) for _, state in heard if state["measured_at_ns"] in truths]
    assert len(pairs) > 0.9 * len(heard), f"{len(pairs)} truths for {len(heard)} states"
    for state, truth in pairs:
        assert state["position_min_m"] <= truth["position_m"] <= state["position_max_m"], (state, truth)
        assert state["speed_min_mps"] <= truth["speed_mps"] <= state["speed_max_mps"], (state, truth)


def test_state_comes_at_50_hz_and_is_right(stack: Stack) -> None:
    listener = stack.listener
    heard = listener.span(listener.wait_for_state(is_whole, 60.0, "a normal state with all sensors"), epochs=500)
    first_at, last_at = heard[0][0], heard[-1][0]
    rate_hz = (len(heard) - 1) / (last_at - first_at)
    stack.figures["states a second"] = rate_hz
    stack.figures["median age ms"] = statistics.median(s["published_at_ns"] - s["measured_at_ns"] for _, s in heard) / 1e6
    assert 47.0 < rate_hz < 53.0
    epochs = [state["epoch"] for _, state in heard]
    assert epochs == sorted(set(epochs)), "an epoch came twice or out of order"
    assert len(epochs) >= 490
    assert {state["status"] for _, state in heard} == {"normal"}
    assert listener.encodings == {"application/msgpack;state/1"}
    for _, state in heard:
        wrong = {
            name: state.get(name, "is missing") for name, kind in FIELDS.items() if not isinstance(state.get(name, ...), kind)
        }
        assert not wrong
        assert state["measured_at_ns"] == state["epoch"] * EPOCH_NS
        assert [len(row) for row in state["covariance"]] == [3, 3, 3]
        assert sum(sensor["share"] for sensor in state["sensors"]) == pytest.approx(1.0)
    check_against_truth(stack, heard)


def test_every_container_becomes_healthy(stack: Stack) -> None:
    waiting = {service: stack.container(service) for service in SERVICES}
    wait_until_healthy(waiting, 90.0)


@pytest.mark.parametrize("service", SERVICES)
def test_no_root_nothing_writable_no_multicast(stack: Stack, service: str) -> None:
    owners = run(["docker", "top", stack.container(service), "-eo", "uid,pid,args"], 30.0).splitlines()[1:]
    assert owners
    assert all(int(line.split()[0]) != 0 for line in owners), owners
    mounts = [line.split() for line in stack.inside(service, "cat /proc/1/mounts").splitlines()]
    options = {mount[1]: mount[3].split(",") for mount in mounts}
    assert "ro" in options["/"]
    assert "rw" in options["/tmp"]
    assert stack.inside(service, "touch /tmp/here && rm /tmp/here && echo writable") == "writable\n"
    assert "NoNewPrivs:\t1" in stack.inside(service, "cat /proc/1/status")
    # 224.0.0.1, all hosts, is the kernel's own; the numbers are written backwards
    groups = [line.split()[0] for line in stack.inside(service, "cat /proc/net/igmp").splitlines() if line.startswith("\t")]
    assert set(groups) <= {"010000E0"}, groups


def test_a_killed_sensor_is_out_at_once_and_back_when_started(stack: Stack) -> None:
    listener = stack.listener
    before = listener.wait_for_state(is_whole, 30.0, "a normal state to begin with")
    tokens = len(listener.tokens)
    run(["docker", "kill", stack.container("sensor-radar-front")], 30.0)
    listener.wait(
        lambda: any(not alive for _, _, alive in listener.tokens[tokens:]), 10.0, "the token of sensor-radar-front to go"
    )
    process, gone_at, _ = next(token for token in listener.tokens[tokens:] if not token[2])
    assert process == "sensor-radar-front"

    out = listener.wait_for_state(lambda state: "radar-front" in units(state, "excluded"), 10.0, "the radar excluded", before)
    out_at, state = listener.states[out]
    stack.figures["sensor out after its token ms"] = (out_at - gone_at) * 1e3
    assert {"unit": "radar-front", "reason": "process gone", "kind": "absent"} in state["excluded"]
    assert out_at - gone_at < SILENCE_S / 2, "the token did not do it"
    heard = listener.span(out, epochs=100)
    for _, state in heard:
        assert state["status"] == "degraded"
        assert set(units(state, "sensors")) == UNITS - {"radar-front"}
        assert sum(sensor["share"] for sensor in state["sensors"]) == pytest.approx(1.0)
    check_against_truth(stack, heard)
    received = [at for at, _ in listener.states[before : out + 1]]
    assert max(b - a for a, b in pairwise(received)) < SILENCE_S, "the state stopped meanwhile"
    assert stack.inspect("sensor-radar-front")["State"]["Status"] == "exited", "`docker kill` is an order, not a crash"

    stack.call("start", "sensor-radar-front")
    back = listener.wait_for_state(is_whole, 20.0, "the radar in use again and a normal state")
    check_against_truth(stack, listener.span(back, epochs=50))


def test_a_crashed_process_comes_back_by_itself(stack: Stack) -> None:
    listener = stack.listener
    before = listener.wait_for_state(is_whole, 30.0, "a normal state to begin with")
    # PID 1 is the engine's init; its child is the process
    stack.inside("filter-loop", "kill -KILL $(cat /proc/1/task/1/children)")
    out = listener.wait_for_state(lambda state: "loop" in units(state, "excluded"), 10.0, "loop excluded", before)
    assert {"unit": "loop", "reason": "process gone", "kind": "absent"} in listener.states[out][1]["excluded"]
    back = listener.wait_for_state(is_whole, 20.0, "loop in use again and a normal state", out)
    stack.figures["crash to normal again s"] = listener.states[back][0] - listener.states[out][0]
    assert stack.inspect("filter-loop")["RestartCount"] == 1
    check_against_truth(stack, listener.span(back, epochs=50))


# the last one: nothing runs after it
def test_stop_ends_every_process_cleanly(stack: Stack) -> None:
    begun = time.monotonic()
    stack.call("stop")
    took_s = stack.figures["stopped within s"] = time.monotonic() - begun
    ends = {service: stack.inspect(service)["State"] for service in SERVICES}
    assert {service: end["ExitCode"] for service, end in ends.items()} == dict.fromkeys(SERVICES, 0)
    assert {end["Status"] for end in ends.values()} == {"exited"}
    assert took_s < 20.0
    # up to the microsecond: the engine writes as many digits as it likes
    finished = {service: end["FinishedAt"][:26] for service, end in ends.items()}
    last = sorted(finished, key=lambda service: finished[service])[-2:]
    assert set(last) == {"router", "router-2"}, "the others could not say goodbye"
