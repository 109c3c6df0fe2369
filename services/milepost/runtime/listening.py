"""Listening to a router from outside, as every tool here does."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from milepost_schemas import BY_NAME, Message, Refused, decode

from . import zenoh_config
from .bus import open_session

Receive = Callable[[str, Message, int], None]


@contextmanager
def listening(endpoints: list[str], streams: Sequence[str], train: str, receive: Receive) -> Iterator[Any]:
    """Call `receive(stream, message, received_at_ns)` for every message of these streams. Raises NoRouterError."""

    def callback_for(name: str) -> Callable[[Any], None]:
        schema = BY_NAME[name].message

        def callback(sample: Any) -> None:
            now = time.time_ns()
            try:
                receive(name, decode(sample.payload.to_bytes(), schema), now)
            except Refused:
                return

        return callback

    with open_session(zenoh_config.tool(endpoints)) as session:
        kept = [session.declare_subscriber(BY_NAME[name].key_for(train), callback_for(name)) for name in streams]
        yield session
        del kept
