"""The recorder's process: every recorded stream of a train into files."""

from __future__ import annotations

import logging
import os
import queue
import signal
import time
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zenoh

from milepost.config.fusion_settings import fingerprint
from milepost.config.train import Train
from milepost.nodes.base import Node
from milepost.recorder.history import STREAMS as HISTORIES
from milepost.recorder.history import BadQuestionError, History, seconds_asked_for
from milepost.recorder.limits import Limits
from milepost.recorder.recorder import Recorder
from milepost.recorder.scenario_clock import MADE_OF, SIMULATION, simulation_facts
from milepost_schemas import BY_NAME, STREAMS, Health, SimulationStart, simulation_start_key

from .. import zenoh_config
from ..bus import Question, Stop, ZenohBus, open_session
from ..clock import Clock
from ..process import set_up_log, stop_on_signals
from ..subscribing import subscriber
from ..together.part import declare_alive
from ..zenoh_config import Connection
from .intake import Intake
from .writer import WriterThread

log = logging.getLogger("milepost")
NAME = "recorder"
ASK_FOR_S = 0.5
LOST = "overflow"


@dataclass(frozen=True)
class RecorderOptions:
    """What the command line says of a recorder; `several`: it is that of one of several trains, whose name its log says."""

    folder: Path
    connection: Connection
    limits: Limits = field(default_factory=Limits)
    parent: int | None = None
    several: bool = False


def run_recorder(train: Train, options: RecorderOptions) -> None:
    """Record a train until stopped. Raises ConfigError for a folder that cannot be written."""
    set_up_log(f"{train.name} {NAME}" if options.several else NAME)
    recorder = Recorder(options.folder, train.name, options.limits, time.time_ns())
    recorder.describe(MADE_OF, {"file": train.path.name, "fingerprint": fingerprint(train)}, time.time_ns())
    # opening waits for a router inside Zenoh, where Python cannot see a signal
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    with open_session(zenoh_config.client(options.connection)) as session:
        bus = ZenohBus(session, train.name)
        stop_on_signals(bus.inbox)
        intake = Intake()
        histories = {BY_NAME[name].key_for(train.name): History() for name in HISTORIES}
        writer = WriterThread(recorder, intake, lambda: bus.inbox.put(Stop()), histories)
        kept = [*_listen(session, train.name, intake), *_offer(session, bus, histories)]
        log.info("recording %s to %s", train.name, options.folder)
        try:
            _Reporter(train, bus, recorder, intake, writer, histories).run(options.parent)
        finally:
            for each in kept:
                each.undeclare()
            writer.end()


def _listen(session: Any, train: str, intake: Intake) -> list[Any]:
    """Subscribe to every recorded stream; readings of all kinds have one key, and are subscribed to once."""

    def receive(sample: Any) -> None:
        intake.put(str(sample.key_expr), time.time_ns(), sample)

    rows = {row.key: row for row in reversed(STREAMS) if row.recorded}
    return [subscriber(session, row, row.key_for(train), receive, paced_too=True) for row in rows.values()]


def _offer(session: Any, bus: ZenohBus, histories: Mapping[str, History]) -> list[Any]:
    """Take questions for what was said lately; they are answered elsewhere, so that what is recorded does not wait."""
    return [session.declare_queryable(key, lambda query, key=key: bus.inbox.put(Question(key, query))) for key in histories]


class _Reporter:
    """Answers for what was said lately, and tells once a second how the recording is doing and what has happened to it."""

    def __init__(
        self,
        train: Train,
        bus: ZenohBus,
        recorder: Recorder,
        intake: Intake,
        writer: WriterThread,
        histories: Mapping[str, History],
    ) -> None:
        self._train = train
        self._bus = bus
        self._recorder = recorder
        self._intake = intake
        self._writer = writer
        self._histories = histories
        self._node = Node(train.name, NAME, uuid.uuid4().hex[:8])
        self._clock = Clock()
        self._start: SimulationStart | None = None
        self._begun_s = self._since_s = time.monotonic()
        self._before: dict[str, int] = {}
        self._lost_before = 0

    def run(self, parent: int | None) -> None:
        """Until stopped, or until `parent` is no longer the parent."""
        declare_alive(self._bus, self._node, NAME)
        due = time.monotonic()
        while parent is None or os.getppid() == parent:
            try:
                item = self._bus.inbox.get(timeout=max(0.0, due - time.monotonic()))
            except queue.Empty:
                self._once_a_second()
                due += 1.0
                continue
            if isinstance(item, Stop):
                return
            if isinstance(item, Question):
                self._answer(item)

    def _answer(self, question: Question) -> None:
        with question.query as query:
            try:
                seconds = seconds_asked_for(str(query.parameters))
            except BadQuestionError as error:
                query.reply_err(str(error), encoding="text/plain")
                return
            for message in self._histories[question.procedure].answer(seconds, time.time_ns()):
                query.reply(message.key, message.payload, encoding=zenoh.Encoding(message.encoding))

    def _once_a_second(self) -> None:
        if self._train.has_scenario_time and self._start is None:
            self._ask_for_start()
        now_ns, lost = self._clock.now_ns(), self._intake.lost
        while self._recorder.notices:
            severity, code, text = self._recorder.notices.pop(0)
            self._tell(severity, code, text, now_ns)
        if lost > self._lost_before:
            text = f"{lost - self._lost_before} messages are missing: they came faster than the disk takes them"
            self._tell("error", "messages_lost", text, now_ns)
            self._lost_before = lost
        self._bus.publish("health", NAME, self._health(now_ns, lost))

    def _tell(self, severity: Any, code: str, text: str, now_ns: int) -> None:
        self._bus.publish(*self._node.event(severity, code, text, now_ns))
        log.warning("%s", text)

    def _ask_for_start(self) -> None:
        told = self._bus.ask(simulation_start_key(self._train.name), SimulationStart, ASK_FOR_S)
        if told:
            self._start = told[0][1]
            self._clock = Clock(self._start)
            self._writer.describe(SIMULATION, simulation_facts(self._start.start_ns, self._start.speed))

    def _health(self, now_ns: int, lost: int) -> Health:
        now_s, received = time.monotonic(), dict(self._recorder.received)
        span = max(now_s - self._since_s, 1e-3)
        rates = {name: (count - self._before.get(name, 0)) / span for name, count in received.items()}
        self._since_s, self._before = now_s, received
        return Health(
            **self._node.head("health", now_ns, now_ns),
            uptime_s=now_s - self._begun_s,
            received_hz=rates,
            sent_hz={"health": 1.0},
            refused={**self._recorder.refused, **({LOST: lost} if lost else {})},
            rewinds=0,
            gaps=self._recorder.gaps.missing,
        )
