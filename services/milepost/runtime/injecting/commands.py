"""Commands to the sensors and fusers of running trains, and their answers."""

from __future__ import annotations

import queue
import threading
import time
import uuid
from pathlib import Path
from typing import Any

import zenoh

from milepost.config.errors import ConfigError
from milepost.config.mistakes import must_be_one_of
from milepost_schemas import BY_NAME, Event, FaultCommand, Message, encode

from ..inbox.taking import take
from ..instances import live_tokens
from ..listening import listening
from ..zenoh_config import Connection, place

SENSOR, FUSER = "sensor-", "fuser"
ANSWERS = ("fault_injected", "fault_cleared", "fault_refused")
# how long the router takes to say that somebody listens
MATCH_S = 1.0
ANSWER_S = 3.0
ALLOWED = "in a secure train the certificate `chaos` may inject faults"


class NoAnswerError(OSError):
    """Nobody is there, or nobody answers."""


def send_command(connection: Connection, train: str, unit: str, fields: dict[str, Any]) -> Event:
    """Send a `FaultCommand` with these fields and wait for the sensor's answer; `train` may be empty where only one runs.

    Raises ConfigError for a train or unit that is not there and for a train that allows no injection, NoRouterError, and
    NoAnswerError.
    """
    answers: queue.SimpleQueue[Event] = queue.SimpleQueue()
    refusals: list[Event] = []
    tool = f"inject-{uuid.uuid4().hex[:8]}"

    def receive(_: str, message: Message, __: int) -> None:
        if isinstance(message, Event) and message.code in ANSWERS and message.text.endswith(f"({tool})"):
            answers.put(message)
        elif isinstance(message, Event) and message.code == "access_refused":
            refusals.append(message)

    with listening(connection, ["event"], train or "*", receive) as session:
        train = _train(session, train, connection)
        _check_unit(session, train, unit)
        now_ns = time.time_ns()
        head: dict[str, Any] = {
            "train": train,
            "unit": unit,
            "instance": tool,
            "measured_at_ns": now_ns,
            "published_at_ns": now_ns,
        }
        _put(session, FaultCommand(**head, sequence=0, **fields))
        try:
            return take(answers, ANSWER_S)
        except queue.Empty:
            raise NoAnswerError(_why_silent(train, unit, refusals, isinstance(connection, Path))) from None


def _why_silent(train: str, unit: str, refusals: list[Event], has_file: bool) -> str:
    """Why a sensor that listens did not answer, as far as this side can tell."""
    key = BY_NAME["chaos"].key_for(train, unit)
    told = [event for event in refusals if key in event.text]
    if told:
        return f"no permission: {told[-1].unit} says: {told[-1].text}; {ALLOWED}"
    text = f"{unit} of {train} is there, but did not answer within {ANSWER_S:g} s: its process hangs"
    # a router says a refusal once, and again after ten seconds
    return f"{text}, or this client has no permission: {ALLOWED}" if has_file else text


def _train(session: Any, train: str, connection: Connection) -> str:
    running = sorted({token.train for token in live_tokens(session)})
    if not running:
        raise NoAnswerError(f"no train is running at {place(connection)}")
    if not train and len(running) > 1:
        raise ConfigError("inject", "--train", f"required: {', '.join(running)} are running")
    if train and train not in running:
        raise ConfigError("inject", "--train", must_be_one_of(running, train))
    return train or running[0]


def _check_unit(session: Any, train: str, unit: str) -> None:
    names = {token.unit for token in live_tokens(session, train)}
    units = sorted(name.removeprefix(SENSOR) for name in names if name.startswith((SENSOR, FUSER)))
    if unit not in units:
        raise ConfigError("inject", "UNIT", must_be_one_of(units, unit))


def _put(session: Any, command: FaultCommand) -> None:
    """Send a command once its sensor listens. Raises ConfigError where it does not."""
    stream, heard = BY_NAME["chaos"], threading.Event()

    def changed(status: Any) -> None:
        if status.matching:
            heard.set()

    encoding = zenoh.Encoding("application/msgpack").with_schema(f"{command.SCHEMA}/{command.VERSION}")
    publisher = session.declare_publisher(stream.key_for(command.train, command.unit), encoding=encoding)
    listener = publisher.declare_matching_listener(changed)
    if not (publisher.matching_status.matching or heard.wait(MATCH_S)):
        text = f"{command.train} allows no injection of faults: its train file does not say `chaos: true`"
        raise ConfigError("inject", "", text)
    publisher.put(encode(command))
    listener.undeclare()
