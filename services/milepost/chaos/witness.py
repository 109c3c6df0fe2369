"""Somebody outside the train who hears what a dispatch tool would hear, and keeps it."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from milepost.offline.collector import no_collection
from milepost.runtime import zenoh_config
from milepost.runtime.instances import Token
from milepost.runtime.listening import listening
from milepost_schemas import Event, FusedState, Health, Message, Truth

from .news import News

ROUTER_WITHIN_MS = 20_000
HEARD = ("state", "truth", "event", "health")


def outsider(connection: zenoh_config.Connection) -> dict[str, Any]:
    """A session that fails over as the train's own do, and gives up where no router comes."""
    config = zenoh_config.client(connection)
    config["connect"]["timeout_ms"] = ROUTER_WITHIN_MS
    return config


class Witness:
    """What has been heard: states with their times of receipt, truths by time, events, the newest health of
    each instance, live tokens.
    """

    def __init__(self) -> None:
        self.news = News()
        self.received: list[tuple[int, FusedState]] = []
        self.truths: dict[int, Truth] = {}
        self.events: list[Event] = []
        self.health: dict[tuple[str, str], Health] = {}
        # another set for each change: who looks at one while a token comes is not disturbed
        self.alive: frozenset[Token] = frozenset()
        self._tokens = threading.Lock()

    def hear(self, _: str, message: Message, now_ns: int) -> None:
        """Keep a message."""
        if isinstance(message, FusedState):
            self.received.append((now_ns, message))
        elif isinstance(message, Truth):
            self.truths[message.measured_at_ns] = message
        elif isinstance(message, Event):
            self.events.append(message)
        elif isinstance(message, Health):
            self.health[message.unit, message.instance] = message
        self.news.heard()

    def see(self, token: Token, alive: bool) -> None:
        """A process came or went."""
        with self._tokens:
            self.alive = self.alive | {token} if alive else self.alive - {token}
        self.news.heard()


@contextmanager
def witnessing(endpoints: list[str]) -> Iterator[Witness]:
    """A witness that listens to all trains at these endpoints. Raises NoRouterError."""
    witness = Witness()
    with no_collection(), listening(endpoints, HEARD, "*", witness.hear, witness.see, config=outsider):
        yield witness
