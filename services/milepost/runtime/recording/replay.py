"""Puts a recording back on the bus, as it was: keys, payloads, encodings, order and pace.

Payloads are sent byte for byte, so their stamps are those of the recording: what they say was true then, and only then. Who
judges by age has to take the time from the messages. A process that fuses refuses them as too old, which is right: a replay
is for whoever watches. To fuse again there is `milepost rerun`.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import zenoh

from milepost.recorder.incoming import Incoming
from milepost.recorder.reading import McapReader, following
from milepost.recorder.rows import place_of, row_of
from milepost.recorder.window import ALL, Window

from .. import zenoh_config
from ..bus import PRIORITIES, open_session
from ..instances import live_tokens
from ..zenoh_config import Connection

# commands to a train's processes are none of its messages: a replay tells nobody what to do
NOT_SENT = frozenset({"chaos"})
PROGRESS_EVERY = 200


class TrainIsRunningError(Exception):
    """The recorded train is there, live: two trains of one name would be told as one."""


@dataclass
class Replayed:
    """What was sent, over how long a stretch of the recording, how late the latest message was, and what could not be read."""

    sent: int = 0
    left_out: int = 0
    span_s: float = 0.0
    latest_s: float = 0.0
    flaws: list[str] = field(default_factory=list)


def replay(
    files: Sequence[Path], speed: float, connection: Connection, progress: Callable[[int], None], window: Window = ALL
) -> Replayed:
    """Send all messages of a window at `speed` times their pace. Raises ConfigError, NoRouterError, TrainIsRunningError."""
    done = Replayed()
    with open_session(zenoh_config.tool(connection), zenoh_log="off") as session:
        sender = _Sender(session, done)
        for message in _paced(_readers(files, window), speed, done, progress):
            sender.send(message)
    return done


def _readers(files: Sequence[Path], window: Window) -> list[list[McapReader]]:
    """Of each train those of its files, in their order."""
    return [[McapReader(path, window) for path in group] for group in following(files)]


def _paced(
    trains: Sequence[Sequence[McapReader]], speed: float, done: Replayed, progress: Callable[[int], None]
) -> Iterator[Incoming]:
    """Each message when its time has come: its receipt after the first one's, divided by the speed."""
    first_ns: int | None = None
    begun_s = time.monotonic()
    # each train's in the order in which they were written; trains that ran at the same time run so again
    recorded = (chain.from_iterable(reader.messages() for reader in readers) for readers in trains)
    for number, message in enumerate(heapq.merge(*recorded, key=lambda message: message.at_ns)):
        if first_ns is None:
            first_ns, begun_s = message.at_ns, time.monotonic()
        done.span_s = max(done.span_s, (message.at_ns - first_ns) * 1e-9)
        wait_s = begun_s + (message.at_ns - first_ns) * 1e-9 / speed - time.monotonic()
        if wait_s > 0.0:
            time.sleep(wait_s)
        done.latest_s = max(done.latest_s, -wait_s)
        yield message
        if number % PROGRESS_EVERY == 0:
            progress(sum(reader.read_bytes for readers in trains for reader in readers))
    done.flaws = [flaw for readers in trains for reader in readers for flaw in reader.flaws]


class _Sender:
    def __init__(self, session: Any, done: Replayed) -> None:
        self._session = session
        self._done = done
        self._publishers: dict[tuple[str, str], Any] = {}
        self._trains: set[str] = set()

    def send(self, message: Incoming) -> None:
        row, place = row_of(message.key, message.encoding), place_of(message.key)
        if row is None or place is None or row.name in NOT_SENT or "*" in message.key:
            self._done.left_out += 1
            return
        if place.train not in self._trains:
            self._check(place.train)
        publisher = self._publishers.get((message.key, message.encoding))
        if publisher is None:
            publisher = self._session.declare_publisher(
                message.key,
                encoding=zenoh.Encoding(message.encoding),
                # unlike a train's process, a replay may wait for a slow listener
                congestion_control=zenoh.CongestionControl.BLOCK,
                priority=PRIORITIES[row.priority],
                express=True,
            )
            self._publishers[message.key, message.encoding] = publisher
        publisher.put(message.payload)
        self._done.sent += 1

    def _check(self, train: str) -> None:
        alive = live_tokens(self._session, train)
        if alive:
            names = ", ".join(sorted({token.unit for token in alive})[:3])
            raise TrainIsRunningError(f"{train} is running at this router ({names}, ...): replay at another one")
        self._trains.add(train)
