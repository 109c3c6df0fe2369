"""The runner, on a real Zenoh session that has no neighbours: what it publishes it hears."""

from __future__ import annotations

import os
import queue
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import msgpack
import pytest
import zenoh

from examples import examples_of, head
from milepost.nodes.base import Node, Output, Subscription
from milepost.runtime.bus import AliveChange, Stop, ZenohBus, open_session
from milepost.runtime.clock import Clock
from milepost.runtime.instances import OVERLAP_S, Token, lasting_others, live_tokens, second_instances
from milepost.runtime.runner import Runner
from milepost.runtime.scenario_time import wait_for_processes
from milepost_schemas import BY_NAME, Event, Feedback, Health, Message, SnapshotPart, SpeedReading, decode, encode, rpc_key

TRAIN = "maglev-1"
MS = 1_000_000
ALONE = {
    "mode": "peer",
    "listen": {"endpoints": []},
    "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
}


class Echo(Node):
    """Says an event for each reading and each tick; `ticks_ns` are when it wants to be called."""

    remembers = True

    def __init__(self) -> None:
        super().__init__(TRAIN, "radar", "i1")
        self.subscriptions = [Subscription("speed_reading", "radar")]
        self.ticks_ns: list[int] = []
        self.alive: list[tuple[str, bool]] = []
        self.said: Feedback | None = None

    def step(self, message: Message, now_ns: int) -> Iterable[Output]:
        if isinstance(message, Feedback):
            self.said = message
            return
        yield self.event("info", "step", f"reading {message.sequence}", now_ns)

    def tick(self, now_ns: int) -> Iterable[Output]:
        due = [at for at in self.ticks_ns if at <= now_ns]
        self.ticks_ns = self.ticks_ns[len(due) :]
        yield self.event("info", "tick", f"{len(due)} due", now_ns)

    def next_tick_ns(self) -> int | None:
        return self.ticks_ns[0] if self.ticks_ns else None

    def unit_alive(self, unit: str, alive: bool) -> None:
        self.alive.append((unit, alive))

    def answer(self, procedure: str) -> Message | None:
        return self.said


class Bench:
    """A node on a bus, its runner in a thread, and what it has published."""

    def __init__(self, session: Any) -> None:
        self.session = session
        self.bus = ZenohBus(session, TRAIN)
        self.node = Echo()
        self.heard: queue.SimpleQueue[Message] = queue.SimpleQueue()
        self._kept = [self._hear(name) for name in ("event", "health")]
        self._thread: threading.Thread | None = None

    def _hear(self, name: str) -> Any:
        row = BY_NAME[name]
        return self.session.declare_subscriber(
            row.key_for(TRAIN), lambda s: self.heard.put(decode(s.payload.to_bytes(), row.message))
        )

    def run(self, every_second: Callable[[int], None] | None = None, **options: Any) -> threading.Thread:
        runner = Runner("sensor-radar", self.node, self.bus, Clock(), **options)
        runner.every_second = every_second
        self._thread = threading.Thread(target=runner.run, daemon=True)
        self._thread.start()
        return self._thread

    def put(self, payload: bytes, unit: str = "radar") -> None:
        self.session.put(BY_NAME["speed_reading"].key_for(TRAIN, unit), payload)

    def next(self, schema: type[Message]) -> Any:
        """The next message of a schema."""
        while True:
            message = self.heard.get(timeout=10.0)
            if isinstance(message, schema):
                return message

    def stop(self) -> None:
        self.bus.inbox.put(Stop())
        if self._thread is not None:
            self._thread.join(5.0)
            assert not self._thread.is_alive()


@pytest.fixture
def bench() -> Iterator[Bench]:
    with open_session(ALONE) as session:
        bench = Bench(session)
        for subscription in bench.node.subscriptions:
            bench.bus.subscribe(subscription.stream, subscription.unit)
        yield bench
        bench.stop()


def reading(sequence: int, **changed: Any) -> SpeedReading:
    fields = {**head(), "published_at_ns": time.time_ns(), "sequence": sequence, **changed}
    return SpeedReading(**fields, speed_mps=20.0, speed_variance_m2ps2=0.04, interval_s=0.01)


def test_a_message_is_stepped_and_what_comes_of_it_published(bench: Bench) -> None:
    bench.run()
    for sequence in (4, 5):
        bench.put(encode(reading(sequence)))
    assert [bench.next(Event).text for _ in range(2)] == ["reading 4", "reading 5"]


def test_what_cannot_be_read_is_refused_counted_and_reported(bench: Bench) -> None:
    bench.run()
    bench.put(b"\xc1")
    bench.put(b"\xc1")
    bench.put(encode(reading(1, train="another")))
    bench.put(encode(reading(2)))
    assert [bench.next(Event).code for _ in range(3)] == ["refused_undecodable", "refused_other_train", "step"]
    assert bench.next(Health).refused == {"undecodable": 2, "other_train": 1}


class ClockByHand(Clock):
    """A clock that shows what it is set to."""

    shown_s = 100.0

    def now_ns(self) -> int:
        return round(self.shown_s * 1e9)


def test_what_is_done_once_a_second_keeps_its_phase_however_late_it_was(bench: Bench) -> None:
    """Nodes of one process that are held up together must not do it together ever after."""
    clock, done_s = ClockByHand(), list[float]()
    runner = Runner("sensor-radar", bench.node, bench.bus, clock, phase=0.3)
    runner.every_second = lambda now_ns: done_s.append(now_ns * 1e-9)
    for at_s in (101.0, 101.3, 102.9, 103.2, 103.4, 107.0, 107.2, 107.4):
        clock.shown_s = at_s
        runner.turn(None)
    assert done_s == pytest.approx([101.3, 102.9, 103.4, 107.0, 107.4])


def test_ticks_come_when_they_are_due(bench: Bench) -> None:
    now = time.time_ns()
    bench.node.ticks_ns = [now - 5 * MS, now - 4 * MS, now + 150 * MS]
    bench.run()
    first, second = bench.next(Event), bench.next(Event)
    assert (first.text, second.text) == ("2 due", "1 due")
    assert second.measured_at_ns >= now + 150 * MS


def test_health_comes_once_a_second_with_rates_and_what_they_should_be(bench: Bench) -> None:
    every_second: list[int] = []
    bench.run(every_second.append, expected_hz={"speed_reading": 100.0})
    for sequence in (1, 2, 5):
        bench.put(encode(reading(sequence)))
    first, second = bench.next(Health), bench.next(Health)
    assert 1.0 < first.received_hz["speed_reading"] <= 3.0
    assert (first.gaps, second.gaps) == (2, 2)
    assert second.received_hz == {}
    assert first.expected_hz == second.expected_hz == {"speed_reading": 100.0}
    # sooner after one that was late, as both keep their phase
    assert second.measured_at_ns - first.measured_at_ns >= 500 * MS
    assert (first.sequence, second.sequence) == (0, 1)
    assert len(every_second) >= 1


def test_health_comes_as_seldom_as_is_said_with_the_rates_of_all_that_time(bench: Bench) -> None:
    """What is done once a second is done all the same."""
    every_second: list[int] = []
    begun_ns = time.time_ns()
    bench.run(every_second.append, health_every_s=2.0)
    for sequence in range(4):
        bench.put(encode(reading(sequence)))
    first, second = bench.next(Health), bench.next(Health)
    assert first.measured_at_ns - begun_ns >= 1_900 * MS
    assert second.measured_at_ns - first.measured_at_ns >= 1_500 * MS
    assert 1.0 < first.received_hz["speed_reading"] <= 2.1
    assert len(every_second) >= 3


def test_it_ends_when_the_node_has_finished(bench: Bench) -> None:
    bench.node.finished = True
    thread = bench.run()
    thread.join(5.0)
    assert not thread.is_alive()


def test_it_ends_when_the_simulation_does(bench: Bench) -> None:
    begun = time.monotonic()
    thread = bench.run(end_ns=time.time_ns() + 200 * MS)
    thread.join(5.0)
    assert not thread.is_alive()
    assert time.monotonic() - begun >= 0.2


def test_it_ends_when_the_process_that_started_it_is_gone(bench: Bench) -> None:
    thread = bench.run(parent=os.getppid() + 1)
    thread.join(5.0)
    assert not thread.is_alive()


def test_tokens_that_appear_and_go_are_told_to_the_node(bench: Bench) -> None:
    bench.run()
    for instance, alive in (("a", True), ("b", True), ("a", False), ("b", False)):
        bench.bus.inbox.put(AliveChange(Token(TRAIN, "fuser", instance), alive))
    bench.put(encode(reading(1)))
    bench.next(Event)
    assert bench.node.alive == [("fuser", True), ("fuser", True), ("fuser", True), ("fuser", False)]


def test_a_question_is_answered_with_the_newest_that_has_come(bench: Bench) -> None:
    bench.bus.serve("latest_feedback", "sensor-radar")
    bench.bus.subscribe_to_newest("feedback")
    bench.run()
    said = examples_of(BY_NAME["feedback"])[0]
    assert list(bench.session.get(rpc_key(TRAIN, "latest_feedback"))) == []
    bench.session.put(BY_NAME["feedback"].key_for(TRAIN), encode(said))
    (reply,) = bench.session.get(rpc_key(TRAIN, "latest_feedback"))
    assert msgpack.unpackb(reply.ok.payload.to_bytes())["sequence"] == said.sequence


def test_what_is_handed_over_goes_out_in_parts_between_the_steps(bench: Bench) -> None:
    """GIVEN a question whose parts wait for readings WHEN another one comes meanwhile THEN only the first is answered."""
    going_on = threading.Event()

    def parts(now_ns: int) -> Iterator[SnapshotPart]:
        for part in range(3):
            assert part == 0 or going_on.wait(5.0)
            yield SnapshotPart(fingerprint="f", taken_at_ns=max(1, now_ns), part=part, parts=3, content=b"x" * 100_000)

    bench.node.peers, bench.node.hand_over = ["sensor-other"], parts  # type: ignore[method-assign]
    bench.bus.serve("snapshot", "sensor-radar")
    bench.run()
    every = {"consolidation": zenoh.ConsolidationMode.NONE, "timeout": 5.0}
    first = bench.session.get(rpc_key(TRAIN, "snapshot"), **every)
    begun = decode(first.recv().ok.payload.to_bytes(), SnapshotPart)
    second = bench.session.get(rpc_key(TRAIN, "snapshot"), **every)
    going_on.set()
    rest = [decode(reply.ok.payload.to_bytes(), SnapshotPart) for reply in first]
    assert [part.part for part in (begun, *rest)] == [0, 1, 2]
    assert {part.taken_at_ns for part in rest} == {begun.taken_at_ns}
    late = [decode(reply.ok.payload.to_bytes(), SnapshotPart) for reply in second]
    assert late == [] or {part.taken_at_ns for part in late} != {begun.taken_at_ns}
    bench.put(encode(reading(1)))
    assert bench.next(Event).text == "reading 1"


def test_a_second_instance_is_an_error_once_and_so_is_its_end_told(bench: Bench) -> None:
    bench.bus.watch_tokens()
    bench.bus.declare_alive("fuser", "a1")
    other = bench.session.liveliness().declare_token(f"milepost/v1/{TRAIN}/alive/fuser/b2")
    bench.run()
    event = bench.next(Event)
    assert (event.severity, event.code) == ("error", "second_instance")
    assert event.text == "fuser has 2 instances (a1, b2): end all but one"
    bench.next(Health)
    other.undeclare()
    event = bench.next(Event)
    assert (event.severity, event.code, event.text) == ("info", "one_instance", "fuser has one instance again")


def test_a_successor_beside_a_dying_ones_token_is_no_second_instance(bench: Bench) -> None:
    bench.bus.watch_tokens()
    token = bench.session.liveliness().declare_token(f"milepost/v1/{TRAIN}/alive/fuser/a1")
    bench.run()
    bench.next(Health)
    bench.bus.declare_alive("fuser", "b2")
    time.sleep(0.95)  # the lease of a process that was cut off
    token.undeclare()
    for _ in range(3):
        bench.next(Health)
    bench.stop()
    left = [bench.heard.get() for _ in range(bench.heard.qsize())]
    assert not [message for message in left if isinstance(message, Event)]


def test_a_newcomer_finds_those_that_stay_and_not_those_that_go(bench: Bench) -> None:
    assert lasting_others(bench.session, TRAIN, "fuser") == set()
    going = bench.session.liveliness().declare_token(f"milepost/v1/{TRAIN}/alive/fuser/a1")
    threading.Timer(0.5, going.undeclare).start()
    begun = time.monotonic()
    assert lasting_others(bench.session, TRAIN, "fuser") == set()
    assert time.monotonic() - begun < OVERLAP_S
    bench.bus.declare_alive("fuser", "b2")
    assert lasting_others(bench.session, TRAIN, "fuser") == {Token(TRAIN, "fuser", "b2")}


def test_one_look_finds_all_processes_that_have_a_second_instance(bench: Bench) -> None:
    for unit, instance in (("fuser", "a1"), ("fuser", "b2"), ("filter-radar", "c3")):
        bench.bus.declare_alive(unit, instance)
    assert len(live_tokens(bench.session)) == 3
    assert second_instances(bench.session) == [(TRAIN, "fuser", ("a1", "b2"))]


def test_world_says_whom_it_waits_for_and_whom_it_begins_without(bench: Bench) -> None:
    told: list[tuple[str, str, str]] = []
    bench.bus.declare_alive("fuser", "a1")

    def tell(*sentence: str) -> None:
        told.append(sentence)  # type: ignore[arg-type]

    names = {"fuser", "filter-radar", "sensor-radar"}
    assert wait_for_processes(bench.bus, names, tell, say_every_s=0.2, give_up_after_s=0.5)
    missing = "filter-radar, sensor-radar"
    assert [code for _, code, _ in told] == ["waiting_for", "waiting_for", "began_without"]
    assert all(missing in text for _, _, text in told)


def test_world_begins_as_soon_as_the_last_one_is_there(bench: Bench) -> None:
    bench.bus.declare_alive("fuser", "a1")
    threading.Timer(0.3, bench.bus.declare_alive, ("filter-radar", "b2")).start()
    begun = time.monotonic()
    assert wait_for_processes(bench.bus, {"fuser", "filter-radar"}, lambda *_: None)
    assert 0.25 < time.monotonic() - begun < 3.0


def test_world_that_is_stopped_while_it_waits_does_not_begin(bench: Bench) -> None:
    threading.Timer(0.2, bench.bus.inbox.put, (Stop(),)).start()
    assert not wait_for_processes(bench.bus, {"fuser"}, lambda *_: None)
