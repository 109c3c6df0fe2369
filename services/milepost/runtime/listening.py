"""Listening to a router from outside, as every tool here does."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import zenoh

from milepost_schemas import BY_NAME, Message, Refused, alive_key, decode

from . import zenoh_config
from .bus import open_session
from .instances import Token, token_of
from .zenoh_config import Connection

Receive = Callable[[str, Message, int], None]
Take = Callable[[str, Any, int], None]
Alive = Callable[[Token, bool], None]


@contextmanager
def listening(
    connection: Connection,
    streams: Sequence[str],
    train: str,
    receive: Receive,
    alive: Alive | None = None,
    config: Callable[[Connection], dict[str, Any]] = zenoh_config.tool,
) -> Iterator[Any]:
    """Call `receive(stream, message, received_at_ns)` for every message of these streams, and `alive` for every token.

    `config` makes the session's configuration: a tool's gives up where no router is, a client's waits. Raises NoRouterError.
    """

    def take(name: str, sample: Any, now_ns: int) -> None:
        try:
            receive(name, decode(sample.payload.to_bytes(), BY_NAME[name].message), now_ns)
        except Refused:
            return

    with taking(connection, streams, train, take, alive, config) as session:
        yield session


@contextmanager
def taking(
    connection: Connection,
    streams: Sequence[str],
    train: str,
    take: Take,
    alive: Alive | None = None,
    config: Callable[[Connection], dict[str, Any]] = zenoh_config.tool,
) -> Iterator[Any]:
    """As `listening`, but call `take(stream, sample, received_at_ns)` with what came as it came, for who decodes later."""

    def callback_for(name: str) -> Callable[[Any], None]:
        return lambda sample: take(name, sample, time.time_ns())

    # a tool's standard output is its answer, for people or machines: nothing else may stand there
    with open_session(config(connection), zenoh_log="off") as session:
        kept = [session.declare_subscriber(BY_NAME[name].key_for(train), callback_for(name)) for name in streams]
        if alive is not None:
            kept.append(_tokens(session, train, alive))
        yield session
        del kept


def _tokens(session: Any, train: str, alive: Alive) -> Any:
    def changed(sample: Any) -> None:
        alive(token_of(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

    return session.liveliness().declare_subscriber(alive_key(train), changed, history=True)
