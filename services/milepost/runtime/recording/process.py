"""The recorder's process: every recorded stream of a train into files."""

from __future__ import annotations

import logging
import os
import queue
import signal
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zenoh

from milepost.config.fusion_settings import fingerprint
from milepost.config.train import Train
from milepost.offline.collector import rare_collection
from milepost.recorder.history import MOST_BYTES, BadQuestionError, History, seconds_asked_for
from milepost.recorder.history import STREAMS as HISTORIES
from milepost.recorder.limits import Limits
from milepost.recorder.recorder import Recorder
from milepost.recorder.scenario_clock import MADE_OF
from milepost.recorder.several import Several, train_of
from milepost_schemas import BY_NAME, STREAMS

from .. import zenoh_config
from ..bus import Inbox, Question, Stop, ZenohBus, open_session
from ..inbox.taking import take
from ..logs.output import zenoh_in_log
from ..logs.records import set_up_log
from ..process import stop_on_signals
from ..subscribing import subscriber
from ..zenoh_config import Connection
from .intake import MOST_KEYS, Intake
from .reporter import NAME as NAME
from .reporter import Reporter
from .writer import WriterThread

log = logging.getLogger("milepost")
ANY_TRAIN = "*"
CHAOS = BY_NAME["chaos"]


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
    run_recorders([train], options)


def run_recorders(trains: Sequence[Train], options: RecorderOptions) -> None:
    """Record trains until stopped, each in files of its own. Raises ConfigError for a folder that cannot be written."""
    set_up_log(NAME, trains[0].name if len(trains) == 1 else "fleet", options.several)
    now_ns = time.time_ns()
    recorders = {train.name: Recorder(options.folder, train.name, options.limits, now_ns) for train in trains}
    for train in trains:
        recorders[train.name].describe(MADE_OF, {"file": train.path.name, "fingerprint": fingerprint(train)}, now_ns)
    # opening waits for a router inside Zenoh, where Python cannot see a signal
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    config = zenoh_config.client(options.connection)
    with rare_collection(), zenoh_in_log(), open_session(config) as session, open_session(config) as only_heard:
        inbox: Inbox = queue.SimpleQueue()
        stop_on_signals(inbox)
        intake = Intake(most_keys=MOST_KEYS * len(trains))
        most_bytes = MOST_BYTES // len(trains)
        histories = {BY_NAME[row].key_for(train.name): History(most_bytes=most_bytes) for train in trains for row in HISTORIES}
        writer = WriterThread(Several(recorders), intake, lambda: inbox.put(Stop()), histories)
        kept = _listen(only_heard, trains, intake)
        kept += _offer(session, inbox, histories)
        for train in trains:
            log.info("recording %s to %s", train.name, options.folder)
        try:
            reporters = [
                Reporter(train, ZenohBus(session, train.name, inbox), recorders[train.name], intake) for train in trains
            ]
            _report(reporters, inbox, histories, options.parent)
        finally:
            for each in kept:
                each.undeclare()
            writer.end()


def _listen(session: Any, trains: Sequence[Train], intake: Intake) -> list[Any]:
    """Subscribe to every recorded stream; readings of all kinds have one key, and are subscribed to once.

    Of several trains, to those of all trains that there are: a session with thousands of subscriptions takes milliseconds to
    find whose a new key is, and loses its connection. Commands to sensors are heard only of trains that take them: by the
    subscribers who sends one sees whether anybody would.
    """
    ours = frozenset(train.name for train in trains)

    def receive(sample: Any) -> None:
        key = str(sample.key_expr)
        if train_of(key) in ours:
            intake.put(key, time.time_ns(), sample)

    # the thread that brings a sample puts it there: a thread for each subscriber would only cost
    put = zenoh.handlers.Callback(receive, indirect=False)
    rows = {row.key: row for row in reversed(STREAMS) if row.recorded and row is not CHAOS}
    every = trains[0].name if len(trains) == 1 else ANY_TRAIN
    keys = [(row, row.key_for(every)) for row in rows.values()]
    keys += [(CHAOS, CHAOS.key_for(train.name)) for train in trains if train.file.chaos]
    return [subscriber(session, row, key, put, paced_too=True) for row, key in keys]


def _offer(session: Any, inbox: Inbox, histories: Mapping[str, History]) -> list[Any]:
    """Take questions for what was said lately; they are answered elsewhere, so that what is recorded does not wait."""
    return [session.declare_queryable(key, lambda query, key=key: inbox.put(Question(key, query))) for key in histories]


def _report(reporters: Sequence[Reporter], inbox: Inbox, histories: Mapping[str, History], parent: int | None) -> None:
    """Tell once a second how each train's recording is doing, and answer questions, until stopped or `parent` is gone."""
    for reporter in reporters:
        reporter.appear()
    due = time.monotonic()
    while parent is None or os.getppid() == parent:
        try:
            item = take(inbox, due - time.monotonic())
        except queue.Empty:
            for reporter in reporters:
                reporter.once_a_second()
            due = max(due + 1.0, time.monotonic())
            continue
        if isinstance(item, Stop):
            return
        if isinstance(item, Question):
            _answer(item, histories)


def _answer(question: Question, histories: Mapping[str, History]) -> None:
    with question.query as query:
        try:
            seconds = seconds_asked_for(str(query.parameters))
        except BadQuestionError as error:
            query.reply_err(str(error), encoding="text/plain")
            return
        for message in histories[question.procedure].answer(seconds, time.time_ns()):
            query.reply(message.key, message.payload, encoding=zenoh.Encoding(message.encoding))
