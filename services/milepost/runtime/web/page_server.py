"""The dispatch page as a process: what it hears on a router, shown in browsers."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import uvicorn

from milepost.page.heard import Heard
from milepost.page.injecting import Answer, Order
from milepost.page.site import site
from milepost.page.viewer import Lines
from milepost.runtime import zenoh_config
from milepost.runtime.instances import Token
from milepost.runtime.listening import taking
from milepost.runtime.stop_signals import StopSignals
from milepost_schemas import BY_NAME

STREAMS = ("state", "hypotheses", "truth", "health", "event")
FORGET_EVERY_S = 10.0
# how long the router takes to say that somebody listens
MATCH_S = 1.0
START_S = 30.0
END_S = 3.0
MOST_PUBLISHERS = 64
Send = Callable[[Order], Answer]


class Chaos:
    """Which trains take faults: those whose sensors listen on `@chaos`. Until there is a session, none."""

    def __init__(self, send: Send) -> None:
        self.send = send
        self._session: Any = None
        self._publishers: dict[str, Any] = {}
        self._lock = threading.Lock()

    def opened(self, session: Any) -> None:
        """A session is there, or, with None, no more."""
        with self._lock:
            self._session = session
            self._publishers.clear()

    def allowed(self, train: str) -> bool:
        """Whether a sensor of the train listens for faults. Waits for the router the first time."""
        with self._lock:
            if self._session is None:
                return False
            new = train not in self._publishers
            if new:
                if len(self._publishers) >= MOST_PUBLISHERS:
                    self._publishers.pop(next(iter(self._publishers))).undeclare()
                self._publishers[train] = self._session.declare_publisher(BY_NAME["chaos"].key_for(train))
            publisher = self._publishers[train]
            heard = threading.Event()
            listener = publisher.declare_matching_listener(lambda status: heard.set() if status.matching else None)
            matching = bool(publisher.matching_status.matching) or (new and heard.wait(MATCH_S))
            listener.undeclare()
            return matching


def _taker(heard: Heard) -> Callable[[str, Any, int], None]:
    def take(stream: str, sample: Any, now_ns: int) -> None:
        _, _, train, *_, unit = str(sample.key_expr).split("/")
        if "*" not in train:
            heard.receive(stream, train, unit, sample.payload.to_bytes(), now_ns)

    return take


@contextmanager
def serving(host: str, port: int, heard: Heard, lines: Lines, chaos: Chaos) -> Iterator[None]:
    """The web server in a thread. Raises OSError where it does not start."""
    # uvicorn says it, but nobody is there to read it
    config = uvicorn.Config(
        site(heard, lines, chaos, host), host=host, port=port, log_config=None, access_log=False, timeout_graceful_shutdown=1
    )
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    deadline = time.monotonic() + START_S
    while not server.started:
        thread.join(0.05)
        if not thread.is_alive() or time.monotonic() > deadline:
            raise OSError(f"no web server could be started on port {port}")
    try:
        yield
    finally:
        server.should_exit = True
        thread.join(END_S)


def run_page(
    connection: zenoh_config.Connection,
    host: str,
    port: int,
    lines: Lines,
    send: Send,
    tell: Callable[[str], None] | None = None,
    url: str = "",
) -> None:
    """Serve what is heard on a router until stopped; waits for one. Raises OSError where it cannot listen there."""
    logging.getLogger("uvicorn").setLevel(logging.CRITICAL)
    heard, chaos = Heard(), Chaos(send)

    def alive(token: Token, there: bool) -> None:
        heard.alive(*token, there, time.time_ns())

    with serving(host, port, heard, lines, chaos):
        if tell is not None:
            shown = f"[{host}]" if ":" in host else host
            tell(f"the dispatch page is at {url or f'http://{shown}:{port}'}")
        # until the session is open, signals just end this process
        with taking(connection, STREAMS, "*", _taker(heard), alive, zenoh_config.client) as session, StopSignals() as stop:
            chaos.opened(session)
            while not stop.wait(FORGET_EVERY_S):
                heard.forget(time.time_ns())
            chaos.opened(None)
