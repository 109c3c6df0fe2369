"""The bus of offline runs: who gets what, in which order, at what time."""

from __future__ import annotations

from collections.abc import Iterable

from milepost.nodes.base import Node, Output, Subscription
from milepost.offline.memory_bus import MemoryBus
from milepost_schemas import Event, Message

Heard = list[tuple[str, str, int]]


class Listener(Node):
    """Notes what it hears; ticks at the given times, each of which it tells as an event."""

    def __init__(self, name: str, heard: Heard, subscriptions: list[Subscription], ticks_ns: Iterable[int] = ()) -> None:
        super().__init__("t", name, "i")
        self.subscriptions = subscriptions
        self.ticks_ns = list(ticks_ns)
        self._heard = heard

    def step(self, message: Message, now_ns: int) -> Iterable[Output]:
        self._heard.append((self.unit, getattr(message, "text", ""), now_ns))
        return ()

    def tick(self, now_ns: int) -> Iterable[Output]:
        self.ticks_ns.pop(0)
        yield self.event("info", "tick", self.unit, now_ns)

    def next_tick_ns(self) -> int | None:
        return self.ticks_ns[0] if self.ticks_ns else None


class Relay(Listener):
    """Says again what it hears, as another stream."""

    def step(self, message: Message, now_ns: int) -> Iterable[Output]:
        yield from super().step(message, now_ns)
        yield Output("fix", "balise", said(f"{getattr(message, 'text', '')}, again"))


EVENTS = [Subscription("event")]


def said(text: str) -> Event:
    fields = {"train": "t", "unit": "u", "instance": "i", "sequence": 0, "measured_at_ns": 1, "published_at_ns": 1}
    return Event(**fields, severity="info", code="c", text=text)


def test_ticks_come_in_order_of_time() -> None:
    heard: Heard = []
    nodes = [Listener("a", heard, EVENTS, [30, 50]), Listener("b", [], [], [10, 40])]
    assert MemoryBus(nodes).run_until(100) is None
    assert heard == [("a", "b", 10), ("a", "a", 30), ("a", "b", 40), ("a", "a", 50)]


def test_a_run_returns_the_time_of_the_next_tick() -> None:
    heard: Heard = []
    bus = MemoryBus([Listener("a", heard, EVENTS, [10, 20, 30])])
    assert bus.run_until(20) == 20
    assert [at for _, _, at in heard] == [10]
    assert bus.run_until(31) is None
    assert [at for _, _, at in heard] == [10, 20, 30]


def test_a_tick_that_is_set_from_outside_is_noticed() -> None:
    heard: Heard = []
    node = Listener("a", heard, EVENTS)
    bus = MemoryBus([node])
    assert bus.run_until(100) is None
    node.ticks_ns = [150]
    assert bus.run_until(200) is None
    assert heard == [("a", "a", 150)]


def test_a_message_reaches_all_that_subscribe_to_its_stream_and_unit() -> None:
    heard: Heard = []
    wanted = {"any": [Subscription("speed_reading")], "radar": [Subscription("speed_reading", "radar")]}
    others = {"loop": [Subscription("speed_reading", "loop")], "other": [Subscription("estimate", "radar")]}
    bus = MemoryBus([Listener(name, heard, wants) for name, wants in {**wanted, **others}.items()])
    bus.inject("speed_reading", "radar", said("hello"), 7)
    assert heard == [("any", "hello", 7), ("radar", "hello", 7)]


def test_outputs_of_a_step_are_delivered_after_it_at_the_same_time() -> None:
    heard: Heard = []
    relay = Relay("relay", heard, EVENTS)
    listener = Listener("listener", heard, [*EVENTS, Subscription("fix")])
    bus = MemoryBus([relay, listener])
    bus.inject("event", "", said("one"), 5)
    assert heard == [("relay", "one", 5), ("listener", "one", 5), ("listener", "one, again", 5)]


def test_a_tap_sees_every_message_once() -> None:
    seen: list[tuple[str, str, int]] = []
    bus = MemoryBus([Listener("a", [], [], [10])], tap=lambda output, now_ns: seen.append((output.stream, output.unit, now_ns)))
    bus.inject("estimate", "radar", said("x"), 3)
    bus.run_until(100)
    assert seen == [("estimate", "radar", 3), ("event", "", 10)]


def test_before_step_is_called_before_each_step() -> None:
    times: list[int] = []
    heard: Heard = []
    bus = MemoryBus([Listener("a", heard, EVENTS, [10, 20])], before_step=lambda now_ns: times.append(now_ns + len(heard)))
    bus.inject("event", "", said("x"), 3)
    bus.run_until(100)
    assert times == [3, 11, 22]


def test_what_wakes_nobody_waits_for_the_next_message_and_only_the_newest_counts() -> None:
    heard: Heard = []
    listener = Listener("a", heard, [Subscription("speed_reading"), Subscription("feedback", newest_only=True)])
    bus = MemoryBus([listener])
    bus.inject("feedback", "", said("old"), 1)
    bus.inject("feedback", "", said("new"), 2)
    assert heard == []
    bus.inject("speed_reading", "radar", said("reading"), 3)
    bus.inject("speed_reading", "radar", said("another"), 4)
    assert heard == [("a", "new", 3), ("a", "reading", 3), ("a", "another", 4)]
