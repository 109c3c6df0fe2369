"""Runs one node on Zenoh: inbox to step, deadlines to tick, outputs to keys, health at intervals."""

from __future__ import annotations

import contextlib
import logging
import os
import queue
import time
from collections.abc import Callable, Iterable, Mapping

from milepost.nodes.base import Node, Output
from milepost_schemas import Health, Refused, encode, rpc_key

from .bus import AliveChange, Question, Received, Stop, ZenohBus
from .catching_up.asking import SNAPSHOT
from .catching_up.handing_over import HandingOver
from .clock import Clock, Turn
from .inbox.flood import MOST_WAITING, Gate
from .inbox.opening import open_message
from .inbox.taking import take
from .instances import Change, Instances
from .logs.records import log_event
from .meter import Meter

SECOND_NS = 1_000_000_000
log = logging.getLogger("milepost")


def second_instance(node: Node, change: Change, now_ns: int) -> Output:
    """The event of a node that a process has more than one instance, or no longer has."""
    if change.instances:
        return node.event("error", "second_instance", change.text, now_ns)
    return node.event("info", "one_instance", change.text, now_ns)


class Runner:
    """The loop of a process. `name` is the process's; `parent` ends it when that process is no longer its parent (`orphaned`).

    `expected_hz` are the rates of its streams as the train file sets them, `health_every_s` how often its health is sent, and
    `phase` by which part of that it comes later, so that many nodes of a process do not all send theirs at once.
    `every_second`: done once a second.
    """

    def __init__(
        self,
        name: str,
        node: Node,
        bus: ZenohBus,
        clock: Clock,
        end_ns: int | None = None,
        parent: int | None = None,
        expected_hz: Mapping[str, float] | None = None,
        health_every_s: float = 1.0,
        phase: float = 0.0,
    ) -> None:
        self._name = name
        self._node = node
        self._bus = bus
        self._clock = clock
        self._end_ns = end_ns
        self._parent = parent
        self._meter = Meter(clock.now_ns(), expected_hz or {})
        self._gate = Gate(expected_hz or {})
        self._second_ns = clock.now_ns() + round((1.0 + phase) * SECOND_NS)
        self._health_every_ns = round(health_every_s * SECOND_NS)
        self._health_ns = clock.now_ns() + round((1.0 + phase) * self._health_every_ns)
        self._health_sequence = 0
        self._instances = Instances()
        self._handing_over = HandingOver(bus, node, name)
        self.every_second: Callable[[int], None] | None = None
        self._tick_ns: int | None = None
        self._turn = Turn(clock)
        node.keep_time(self._turn)
        self._ended = self.orphaned = False

    @property
    def over(self) -> bool:
        """Whether it has nothing more to do: its node has finished, or the simulation has ended."""
        return self._ended or self._node.finished

    def run(self) -> bool:
        """Until stopped, finished, or the simulation's end; whether it was stopped."""
        inbox, clock = self._bus.inbox, self._clock
        while not self.over and not self.orphaned:
            wake_ns, item = self.wake_ns(), None
            with contextlib.suppress(queue.Empty):
                item = take(inbox, clock.wait_s(wake_ns))
            if isinstance(item, Stop):
                return True
            self.turn(item)
        return self.orphaned

    def wake_ns(self) -> int:
        """When the next turn is due, if nothing comes before; ask after every turn."""
        self._tick_ns = self._node.next_tick_ns()
        if self._handing_over.busy:
            return self._clock.now_ns()
        return self._second_ns if self._tick_ns is None else min(self._tick_ns, self._second_ns)

    def turn(self, item: Received | AliveChange | Question | None) -> None:
        """Take what has come, if anything, and do what is due. What the node raises is told as an event, and raised."""
        now_ns = self._turn.begin(item.at_utc_ns if isinstance(item, Received) else None)
        begun, handing_over, tick_ns = time.perf_counter(), self._handing_over.busy, self._tick_ns
        try:
            if item is not None:
                self._take(item, now_ns)
            if tick_ns is not None and now_ns >= tick_ns:
                self._send(self._node.tick(now_ns))
            if handing_over:
                self._handing_over.next()
        except Exception as error:
            text = f"{self._name} ends: {type(error).__name__}: {error}"
            self._send([self._node.event("error", "process_failed", text, now_ns)])
            raise
        self._meter.stepped(time.perf_counter() - begun)
        if now_ns >= self._second_ns:
            self._once_a_second(now_ns)
        self._ended = self._end_ns is not None and now_ns >= self._end_ns

    def _take(self, item: Received | AliveChange | Question, now_ns: int) -> None:
        if isinstance(item, Received):
            self._bus.waiting.leaves(item.key)
            self._read_newest(now_ns)
            self._step(item, now_ns)
        elif isinstance(item, AliveChange):
            train, unit, _ = item.token
            self._instances.changed(item.token, item.alive, time.monotonic())
            self._node.unit_alive(unit, self._instances.live(train, unit))
        else:
            self._answer(item, now_ns)

    def _read_newest(self, now_ns: int) -> None:
        for newest in self._bus.newest():
            self._step(newest, now_ns)

    def _step(self, received: Received, now_ns: int) -> None:
        try:
            message = open_message(received, self._bus.train, self._gate, now_ns)
        except Refused as refused:
            self._send(self._node.refuse(refused.reason, refused.detail, now_ns))
            return
        self._meter.received(received.stream.name, message, now_ns)
        self._send(self._node.step(message, now_ns))

    def _answer(self, question: Question, now_ns: int) -> None:
        # a node that sleeps between readings has not looked at the newest yet
        self._read_newest(now_ns)
        if question.procedure == SNAPSHOT:
            self._handing_over.begin(question, now_ns)
            return
        with question.query as query:
            answer = self._node.answer(question.procedure)
            # who has nothing to say yet says nothing: an error would be on the key of the question, which covers others' keys
            if answer is not None:
                # each on its own key: of several replies on one key Zenoh keeps one
                query.reply(rpc_key(self._bus.train, question.procedure, self._name), encode(answer))

    def _send(self, outputs: Iterable[Output]) -> None:
        for stream, unit, message in outputs:
            self._bus.publish(stream, unit, message)
            self._meter.sent(stream)
            if stream == "event":
                log_event(message)

    def _once_a_second(self, now_ns: int) -> None:
        """What waited too long, health where it is due, and processes that have a second instance."""
        # however late this one was: nodes of a process that are held up together do not go together ever after
        self._second_ns += SECOND_NS * ((now_ns - self._second_ns) // SECOND_NS + 1)
        if self._bus.waiting.dropped:
            text = f"more than {MOST_WAITING} messages of a key were waiting; the others were dropped unread"
            self._send(self._node.refuse("overflow", text, now_ns))
            self._node.refusals.counts["overflow"] = self._bus.waiting.dropped
        if now_ns >= self._health_ns:
            self._send_health(now_ns)
        self._send(second_instance(self._node, change, now_ns) for change in self._instances.changes(time.monotonic()))
        if self.every_second is not None:
            self.every_second(now_ns)
        self.orphaned = self._parent_is_gone()

    def _send_health(self, now_ns: int) -> None:
        # what is due every so many seconds is due with one of them, not a moment after it
        self._health_ns = now_ns + self._health_every_ns - SECOND_NS // 2
        body = self._meter.report(now_ns, dict(self._node.refusals.counts), self._node.rewinds)
        health = Health(
            train=self._bus.train,
            unit=self._name,
            instance=self._node.instance,
            sequence=self._health_sequence,
            measured_at_ns=now_ns,
            published_at_ns=now_ns,
            **body,
        )
        self._health_sequence += 1
        self._bus.publish("health", self._name, health)

    def _parent_is_gone(self) -> bool:
        if self._parent is None or os.getppid() == self._parent:
            return False
        log.warning("the process that started this one is gone: ending")
        return True
