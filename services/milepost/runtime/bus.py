"""Zenoh: one merged inbox, publishers with the stream table's quality of service, tokens, procedures."""

from __future__ import annotations

import contextlib
import json
import logging
import queue
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

import zenoh
import zenoh.ext

from milepost_schemas import BY_NAME, Message, Part, Refused, Stream, alive_key, decode, encode, rpc_key

from .inbox.flood import Waiting
from .instances import Token, token_of
from .sessions.hearing import hearing_well
from .sessions.reach import HOW_TO_START, advice
from .subscribing import subscriber

PRIORITIES = {
    "real_time": zenoh.Priority.REAL_TIME,
    "interactive_high": zenoh.Priority.INTERACTIVE_HIGH,
    "data_high": zenoh.Priority.DATA_HIGH,
    "data": zenoh.Priority.DATA,
    "background": zenoh.Priority.BACKGROUND,
}
log = logging.getLogger("milepost")
P = TypeVar("P", bound=Part)
HEARTBEAT_S = 0.5
# a process that waits for a router says so after this time
SAY_WAITING_AFTER_S = 3.0
# Rejected: one thread for all of Zenoh's work (ZENOH_RUNTIME with `handover`). It saves a fifth of the processor and lost
# a hundred states in two seconds, twice in four runs.
# the binding's stubs ask for both of two options that exclude each other
MISS_DETECTION: Any = zenoh.ext.MissDetectionConfig


@dataclass(frozen=True, slots=True)
class Received:
    """A sample as it came; decoding is the reader's work, not the network thread's."""

    stream: Stream
    sample: Any
    at_utc_ns: int
    key: str


@dataclass(frozen=True, slots=True)
class AliveChange:
    """A process's token appeared or went."""

    token: Token
    alive: bool


@dataclass(frozen=True, slots=True)
class Question:
    """A procedure call that waits for an answer."""

    procedure: str
    query: Any


@dataclass(frozen=True, slots=True)
class Stop:
    """The process shall end."""


Inbox = queue.SimpleQueue[Received | AliveChange | Question | Stop]


class NoRouterError(ConnectionError):
    """No session could be opened: nobody there, or an endpoint that is none."""


@contextmanager
def open_session(config: dict[str, Any], zenoh_log: str = "error") -> Iterator[Any]:
    """A Zenoh session that is closed whatever happens: without that, a crashed process would keep its token alive.

    A client makes its connection anew where nothing comes back over it, and so does a router that links itself with others.
    `zenoh_log`: from which level on Zenoh logs, where RUST_LOG does not say. It writes to standard output.
    """
    zenoh.init_log_from_env_or(zenoh_log)
    with _open(config) as session, hearing_well(session, config):
        yield session


def _open(config: dict[str, Any]) -> Any:
    """Open a session; a client without a time limit says that it waits. Raises NoRouterError."""
    # a router's file, once read, has every option of Zenoh's, those of clients too
    client = config.get("mode") == "client"
    named = config.get("connect" if client else "listen", {}).get("endpoints", [])
    endpoints = ", ".join(named)
    waiting = threading.Timer(SAY_WAITING_AFTER_S, log.warning, (f"no router at {endpoints} yet: {HOW_TO_START}",))
    waiting.daemon = True
    if client and config["connect"]["timeout_ms"] == -1:
        waiting.start()
    try:
        return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
    except zenoh.ZError as error:
        what = f"no router at {endpoints}: {advice(named)}" if client else f"cannot listen on {endpoints}"
        raise NoRouterError(f"{what} ({_first_line(error)})") from error
    finally:
        waiting.cancel()


def _first_line(error: Exception) -> str:
    # Zenoh adds the places in its own source
    return str(error).splitlines()[0].partition(" at /")[0]


class ZenohBus:
    """One process's side of the bus. Callbacks only enqueue: a slow one would stop all keys of the session.

    `shared`: many share the session. Then the thread that brings something enqueues it (from the same session the sender's), as
    a thread for each subscriber would only cost; and what goes out at once goes in one packet, as the queue takes few.
    """

    def __init__(self, session: Any, train: str, inbox: Inbox | None = None, shared: bool = False) -> None:
        self.session = session
        self.train = train
        self.inbox: Inbox = queue.SimpleQueue() if inbox is None else inbox
        self._shared = shared
        self.waiting = Waiting()
        self._publishers: dict[tuple[str, str], Any] = {}
        self._newest: list[tuple[Stream, Any]] = []
        self._kept: list[Any] = []

    def subscribe(self, stream_name: str, unit: str = "*") -> None:
        """Receive a stream. Where its publishers remember, what an interruption lost is asked for again."""
        stream = BY_NAME[stream_name]
        put, now, enters = self.inbox.put, time.time_ns, self.waiting.enters

        def receive(sample: Any) -> None:
            key = str(sample.key_expr)
            if enters(key):
                put(Received(stream, sample, now(), key))

        self._kept.append(subscriber(self.session, stream, stream.key_for(self.train, unit), self._callback(receive)))

    def _callback(self, receive: Callable[[Any], None]) -> Any:
        return zenoh.handlers.Callback(receive, indirect=False) if self._shared else receive

    def subscribe_to_newest(self, stream_name: str, unit: str = "*") -> None:
        """Keep the newest message of a stream until it is asked for; older ones are overwritten, and nobody is woken."""
        stream = BY_NAME[stream_name]
        ring = self.session.declare_subscriber(stream.key_for(self.train, unit), zenoh.handlers.RingChannel(1))
        self._newest.append((stream, ring))

    def newest(self) -> Iterator[Received]:
        """What has come since the last time on streams of which only the newest matters."""
        for stream, ring in self._newest:
            sample = ring.try_recv()
            if sample is not None:
                yield Received(stream, sample, time.time_ns(), str(sample.key_expr))

    def watch_tokens(self) -> Any:
        """Receive the coming and going of every process of the train, beginning with those that are there.

        Until what it returns is undeclared.
        """

        def changed(sample: Any) -> None:
            self.inbox.put(AliveChange(token_of(sample.key_expr), sample.kind == zenoh.SampleKind.PUT))

        watch = self.session.liveliness().declare_subscriber(alive_key(self.train), self._callback(changed), history=True)
        self._kept.append(watch)
        return watch

    def declare_alive(self, unit: str, instance: str) -> None:
        """Show that this instance lives, until the session ends."""
        self._kept.append(self.session.liveliness().declare_token(alive_key(self.train, unit, instance)))

    def serve(self, procedure: str, unit: str) -> None:
        """Receive calls of a procedure."""

        def asked(query: Any) -> None:
            self.inbox.put(Question(procedure, query))

        self._kept.append(self.session.declare_queryable(rpc_key(self.train, procedure, unit), self._callback(asked)))

    def publish(self, stream_name: str, unit: str, message: Message) -> None:
        """Send a message on its stream's key. Never blocks: what cannot be sent is dropped, and sequence numbers show it."""
        publisher = self._publishers.get((stream_name, unit))
        if publisher is None:
            publisher = self._publishers[(stream_name, unit)] = self._declare(BY_NAME[stream_name], unit)
        publisher.put(encode(message))

    def leave(self) -> None:
        """Undeclare all, the token first, as the end of a session does."""
        for each in [*reversed(self._kept), *(ring for _, ring in self._newest), *self._publishers.values()]:
            with contextlib.suppress(zenoh.ZError):  # it is undeclared already
                each.undeclare()
        self._kept, self._newest, self._publishers = [], [], {}

    def _declare(self, stream: Stream, unit: str) -> Any:
        key = stream.key_for(self.train, unit)
        quality: dict[str, Any] = {
            "encoding": zenoh.Encoding("application/msgpack").with_schema(f"{stream.message.SCHEMA}/{stream.message.VERSION}"),
            "congestion_control": zenoh.CongestionControl.DROP,
            "priority": PRIORITIES[stream.priority],
            # what nobody waits for shares packets: the queue takes 16, and a recorder tells of 200 trains at once
            "express": not self._shared and stream.priority != "background",
        }
        if not stream.cached:
            return self.session.declare_publisher(key, **quality)
        return zenoh.ext.declare_advanced_publisher(
            self.session,
            key,
            cache=zenoh.ext.CacheConfig(stream.cached),
            sample_miss_detection=MISS_DETECTION(heartbeat=HEARTBEAT_S),
            publisher_detection=True,
            **quality,
        )

    def ask(self, key: str, schema: type[P], timeout_s: float, droppable: bool = False) -> list[tuple[str, P]]:
        """All answers of other processes to a query, each with the last word of its key; unreadable ones are left out.

        `droppable`: a process that cannot send its answer at once drops it, and goes on.
        """
        answers: list[tuple[str, P]] = []
        # of several answers on one key Zenoh would keep one, and where one calls itself complete ask that one alone: a
        # stranger as well as the train's own process
        every: dict[str, Any] = {
            "consolidation": zenoh.ConsolidationMode.NONE,
            "target": zenoh.QueryTarget.ALL,
            "allowed_destination": zenoh.Locality.REMOTE,
        }
        if droppable:
            every["congestion_control"] = zenoh.CongestionControl.DROP
        for reply in self.session.get(key, timeout=timeout_s, **every):
            if reply.ok is None:
                continue
            told = str(reply.ok.key_expr)
            try:
                answers.append((told.rpartition("/")[2], decode(reply.ok.payload.to_bytes(), schema)))
            except Refused as refused:
                log.warning("an answer on %s is not used: %s", told, refused.detail)
        return answers
