"""Two fusers, one of which ends, stops or is cut off: outside there is one train of states, and no step in it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from itertools import pairwise
from typing import Any

from harness import MAGLEV, PERIOD_NS, Journey, at, travel

from milepost.config.roles import ROLES, Setting, processes
from milepost.config.train import load_train
from milepost.nodes.base import Lateness, Node, Output
from milepost.nodes.faulty import Wrapped
from milepost.offline.memory_bus import MemoryBus
from milepost.offline.run import OFFLINE_START_NS
from milepost_schemas import Event, FusedState, Message, Truth

HEAD = {"unit", "instance", "sequence", "published_at_ns"}
HAPPENS_S, STOPPED_S, END_S = 5.0, 2.0, 10.0
# shorter than the lease, but its last sign of life was older
MOMENT_S = 0.45


class Mortal(Wrapped):
    """A process that a test ends, stops for a while (what comes meanwhile waits), or cuts off (it is lost both ways)."""

    def __init__(self, inner: Node) -> None:
        super().__init__(inner)
        self.dead = self.cut = False
        self.stopped_until_ns = 0
        self._waiting: list[Message] = []

    def carry(self, output: Output, now_ns: int) -> Iterable[tuple[Output, float]]:
        return () if self.cut else ((output, 0.0),)

    def step(self, message: Message, now_ns: int) -> Iterable[Output]:
        if self.dead or self.cut:
            return ()
        if now_ns < self.stopped_until_ns:
            self._waiting.append(message)
            return ()
        waiting, self._waiting = self._waiting, []
        return [out for each in (*waiting, message) for out in super(Mortal, self).step(each, now_ns)]

    def lose_what_waits(self) -> None:
        self._waiting = []

    def next_tick_ns(self) -> int | None:
        due_ns = super().next_tick_ns()
        return None if self.dead or due_ns is None else max(due_ns, self.stopped_until_ns)


class Machine(Lateness):
    """A machine's steady clock: it goes on while a process is stopped, and whatever its clock shows."""

    def __init__(self) -> None:
        self.now_ns = 0

    def goes_on(self, now_ns: int) -> None:
        self.now_ns = now_ns

    def steady_ns(self, now_ns: int) -> int:
        return self.now_ns


class Pair:
    """A maglev train with two fusers, each in the hands of the test, and what a dispatch tool would have seen."""

    def __init__(self, around: Callable[[Node], Any] = Mortal, **others: Callable[[Node], Any]) -> None:
        """`others`: what is around other processes, by role."""
        train = load_train(MAGLEV, {"fusion": {"replicas": 2}})
        self.states: list[tuple[FusedState, int]] = []
        self.truth: dict[int, Truth] = {}
        self.events: list[Event] = []
        self.fusers: dict[str, Any] = {}
        self.others: dict[str, Any] = {}
        setting = Setting("", train.world(END_S), OFFLINE_START_NS, live=True)
        nodes, machine = [], Machine()
        for process in processes(train, live=True):
            named = Setting(process.name, setting.world, OFFLINE_START_NS, live=True)
            node = ROLES[process.role].build(train, process.unit, named)
            if process.role == "fuser":
                node.keep_time(machine)
                node = self.fusers[process.name] = around(node)
            elif process.role in others:
                node = self.others[process.name] = others[process.role](node)
            nodes.append(node)
        self.bus = MemoryBus(nodes, self._tap, machine.goes_on)
        for name in self.fusers:
            self.token(name, True)

    def _tap(self, output: Output, now_ns: int) -> None:
        if isinstance(output.message, FusedState):
            self.states.append((output.message, now_ns))
        elif isinstance(output.message, Truth):
            self.truth[output.message.measured_at_ns] = output.message
        elif isinstance(output.message, Event):
            self.events.append(output.message)

    def token(self, name: str, alive: bool) -> None:
        for fuser in self.fusers.values():
            fuser.inner.unit_alive(name, alive)

    def until(self, t_s: float) -> None:
        self.bus.run_until(at(t_s))

    @property
    def speakers(self) -> list[str]:
        """Who spoke, in order, each once in a row."""
        units = [state.unit for state, _ in self.states]
        return [unit for unit, before in zip(units, ["", *units], strict=False) if unit != before]

    def longest_gap_ms(self) -> float:
        received = [now for _, now in self.states]
        return max(b - a for a, b in pairwise(received)) / 1e6


def test_a_standby_says_nothing() -> None:
    pair = Pair()
    pair.until(END_S)
    assert pair.speakers == ["fuser"]
    assert no_epoch_twice_or_missing(pair)


def test_where_the_leader_ends_the_standby_continues() -> None:
    pair = Pair()
    pair.until(HAPPENS_S)
    pair.fusers["fuser"].dead = True
    pair.token("fuser", False)
    pair.until(END_S)
    assert pair.speakers == ["fuser", "fuser-2"]
    assert no_epoch_twice_or_missing(pair)
    assert pair.longest_gap_ms() <= 40.0
    assert same_as_one_fuser(pair)


def test_where_the_leader_stops_the_standby_continues_and_the_leader_that_wakes_is_silent() -> None:
    pair = Pair()
    pair.until(HAPPENS_S)
    pair.fusers["fuser"].stopped_until_ns = at(HAPPENS_S + STOPPED_S)
    pair.until(END_S)
    assert pair.speakers == ["fuser", "fuser-2"]
    assert no_epoch_twice_or_missing(pair)
    assert pair.longest_gap_ms() <= 130.0
    assert same_as_one_fuser(pair)


def test_a_standby_that_lost_its_connection_in_a_moments_stop_does_not_take_the_leaders_token_for_its_end() -> None:
    """GIVEN a stop that ends with the tokens going, before anything else is heard, WHEN they come back, THEN it stands by."""
    pair = Pair()
    standby = pair.fusers["fuser-2"]
    pair.until(HAPPENS_S)
    standby.stopped_until_ns = at(HAPPENS_S + MOMENT_S)
    pair.until(HAPPENS_S + MOMENT_S)
    standby.lose_what_waits()
    pair.token("fuser", False)
    pair.until(HAPPENS_S + MOMENT_S + 0.01)
    pair.token("fuser", True)
    pair.until(END_S)
    assert pair.speakers == ["fuser"]
    assert no_epoch_twice_or_missing(pair)


def test_a_leader_that_was_cut_off_gives_way() -> None:
    pair = Pair()
    pair.until(HAPPENS_S)
    pair.fusers["fuser"].cut = True
    pair.until(HAPPENS_S + STOPPED_S)
    pair.fusers["fuser"].cut = False
    pair.until(END_S)
    assert pair.speakers[:2] == ["fuser", "fuser-2"]
    assert pair.speakers[-1] == "fuser-2"
    late = [state for state, _ in pair.states if state.unit == "fuser" and state.measured_at_ns > at(HAPPENS_S + STOPPED_S)]
    assert len(late) <= 4, "it gives way within three epochs"


def test_the_numbers_of_each_instance_have_no_hole() -> None:
    pair = Pair()
    pair.until(HAPPENS_S)
    pair.fusers["fuser"].dead = True
    pair.token("fuser", False)
    pair.until(END_S)
    for name in pair.fusers:
        numbers = [state.sequence for state, _ in pair.states if state.unit == name]
        assert numbers == list(range(len(numbers)))


def no_epoch_twice_or_missing(pair: Pair) -> bool:
    epochs = [state.epoch for state, _ in pair.states]
    return epochs == list(range(epochs[0], epochs[0] + len(epochs)))


@cache
def alone() -> Journey:
    return travel(END_S)


def same_as_one_fuser(pair: Pair) -> bool:
    """Every state, but for who sent it, and when, is that of a train with one fuser."""
    expected = alone().live
    compared = [
        state.model_dump(exclude=HEAD) == expected[state.measured_at_ns].model_dump(exclude=HEAD) for state, _ in pair.states
    ]
    assert len(compared) > 0.9 * END_S * 1e9 / PERIOD_NS
    return all(compared)
