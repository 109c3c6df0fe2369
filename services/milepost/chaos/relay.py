"""A man in the middle: a router of its own for one process, and two sessions that carry everything between it and the train.

The process that connects to `endpoint` reaches the train only through here. What it publishes on the key under attack is
tampered with; everything else, queries and liveliness tokens too, is carried as it is.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from typing import Any

from milepost.runtime import zenoh_config

from .running import free_port

# a sample's payload in, what is sent on instead, each after so many seconds
Tamper = Callable[[bytes], Iterable[tuple[float, bytes]]]
QUERIED = ("milepost/v1/*/@rpc/**", "milepost/v1/*/@sim/start")
SPOKEN = ("milepost/v1/**", "milepost/v1/*/@sim/truth")
TOKENS = "milepost/v1/*/alive/**"


class Relay:
    """Runs inside a `with` block. `heard` are the keys that the process behind it listens to."""

    def __init__(self, endpoints: list[str], heard: Sequence[str]) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self._endpoints = endpoints
        self._heard = heard
        self._exit = ExitStack()
        self._kept: list[Any] = []
        self._tokens: dict[str, Any] = {}
        self._under: tuple[str, Tamper] | None = None

    def __enter__(self) -> Relay:
        import zenoh

        def opened(config: dict[str, Any]) -> Any:
            return self._exit.enter_context(zenoh.open(zenoh.Config.from_json5(json.dumps(config))))

        opened(zenoh_config.router([self.endpoint]))
        inner, outer = opened(zenoh_config.client([self.endpoint])), opened(zenoh_config.client(self._endpoints))
        elsewhere = zenoh.Locality.REMOTE
        for key in SPOKEN:
            self._kept.append(inner.declare_subscriber(key, self._tampering(outer), allowed_origin=elsewhere))
        for key in self._heard:
            self._kept.append(outer.declare_subscriber(key, _carrying(inner), allowed_origin=elsewhere))
        for key in QUERIED:
            self._kept.append(inner.declare_queryable(key, _asking(outer), allowed_origin=elsewhere))
        self._kept.append(inner.liveliness().declare_subscriber(TOKENS, self._mirroring(outer), history=True))
        return self

    def __exit__(self, *failure: object) -> None:
        # a callback that sends while its session closes is an error
        for each in self._kept:
            each.undeclare()
        self._tokens.clear()
        self._exit.close()

    def attack(self, key: str, tamper: Tamper) -> None:
        """From now on, tamper with what the process publishes on this key."""
        self._under = key, tamper

    def relent(self) -> None:
        """Carry everything as it is again."""
        self._under = None

    def _tampering(self, session: Any) -> Callable[[Any], None]:
        carry = _carrying(session)

        def receive(sample: Any) -> None:
            under = self._under
            if under is None or str(sample.key_expr) != under[0]:
                carry(sample)
                return
            for after_s, payload in under[1](sample.payload.to_bytes()):
                if after_s > 0.0:
                    timer = threading.Timer(after_s, _put, (session, sample, payload))
                    timer.daemon = True
                    timer.start()
                else:
                    _put(session, sample, payload)

        return receive

    def _mirroring(self, session: Any) -> Callable[[Any], None]:
        import zenoh

        def changed(sample: Any) -> None:
            key = str(sample.key_expr)
            if sample.kind == zenoh.SampleKind.PUT:
                self._tokens[key] = session.liveliness().declare_token(key)
            else:
                self._tokens.pop(key, None)

        return changed


def _put(session: Any, sample: Any, payload: bytes) -> None:
    session.put(
        sample.key_expr,
        payload,
        encoding=sample.encoding,
        priority=sample.priority,
        congestion_control=sample.congestion_control,
        express=True,
    )


def _carrying(session: Any) -> Callable[[Any], None]:
    return lambda sample: _put(session, sample, sample.payload.to_bytes())


def _asking(session: Any) -> Callable[[Any], None]:
    def ask(query: Any) -> None:
        # answered in a thread of its own: Zenoh's must not wait
        threading.Thread(target=_answer, args=(session, query), daemon=True).start()

    return ask


def _answer(session: Any, query: Any) -> None:
    with query:
        for reply in session.get(query.selector, timeout=1.0):
            if reply.ok is not None:
                query.reply(reply.ok.key_expr, reply.ok.payload.to_bytes(), encoding=reply.ok.encoding)
