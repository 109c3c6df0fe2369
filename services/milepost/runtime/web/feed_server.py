"""One small web server for machines: what it hears on a router, as metrics, vehicle positions and GeoJSON."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import NamedTuple

from prometheus_client.exposition import choose_encoder
from prometheus_client.metrics_core import Metric as Family

from milepost.feeds.fleet import Fleet
from milepost.feeds.metrics import families
from milepost.feeds.train_geojson import Tracks, train_geojson
from milepost.feeds.vehicle_positions import vehicle_positions
from milepost.runtime import zenoh_config
from milepost.runtime.instances import Token
from milepost.runtime.listening import listening
from milepost.runtime.stop_signals import StopSignals
from milepost_schemas import FusedState, Message

STREAMS = ("state", "health", "event")
CLIENT_TIMEOUT_S = 5.0
FORGET_EVERY_S = 10.0


class Page(NamedTuple):
    """An answer: its type and content."""

    kind: str
    content: bytes


class Collected:
    """Families that were collected already, as the library's encoders want them."""

    def __init__(self, found: list[Family]) -> None:
        self._found = found

    def collect(self) -> Iterator[Family]:
        """The families."""
        return iter(self._found)


class Feed:
    """What is heard, and the pages that are made of it. Zenoh's threads write, the web server's read."""

    def __init__(self, tracks: Tracks) -> None:
        self._fleet, self._tracks = Fleet(), tracks
        self._lock = threading.Lock()
        self.pages: dict[str, Callable[[str], Page]] = {
            "/metrics": self._metrics,
            "/vehicle-positions.pb": self._vehicle_positions,
            "/trains.geojson": self._geojson,
        }

    def receive(self, _: str, message: Message, now_ns: int) -> None:
        """Take a message."""
        with self._lock:
            self._fleet.receive(message, now_ns)

    def alive(self, token: Token, there: bool) -> None:
        """A process's token appeared or went."""
        with self._lock:
            self._fleet.alive(*token, there, time.time_ns())

    def forget(self) -> None:
        """Forget who was silent for long."""
        with self._lock:
            self._fleet.forget(time.time_ns())

    def _states(self, now_ns: int) -> list[FusedState]:
        with self._lock:
            return self._fleet.states(now_ns)

    def _metrics(self, accepted: str) -> Page:
        with self._lock:
            found = list(families(self._fleet, time.time_ns()))
        encode, kind = choose_encoder(accepted)
        return Page(kind, encode(Collected(found)))

    def _vehicle_positions(self, _: str) -> Page:
        now_ns = time.time_ns()
        return Page("application/x-protobuf", vehicle_positions(self._states(now_ns), now_ns))

    def _geojson(self, _: str) -> Page:
        found = train_geojson(self._states(time.time_ns()), self._tracks)
        return Page("application/geo+json", json.dumps(found).encode())


class Server(ThreadingHTTPServer):
    """The web server of a feed."""

    daemon_threads = True
    # with the library's five, the sixth of several clients at once waits for a second
    request_queue_size = 128

    def __init__(self, host: str, port: int, feed: Feed) -> None:
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self.feed = feed
        super().__init__((host, port), Handler)


class Handler(BaseHTTPRequestHandler):
    """Answers one request."""

    server: Server
    timeout = CLIENT_TIMEOUT_S
    server_version, sys_version = "milepost", ""

    def do_GET(self) -> None:
        """A page, or 404 with the names of those that there are."""
        pages = self.server.feed.pages
        make = pages.get(self.path.partition("?")[0])
        if make is None:
            known = "".join(f"{path}\n" for path in pages).encode()
            found = self.path == "/"
            self._answer(HTTPStatus.OK if found else HTTPStatus.NOT_FOUND, Page("text/plain; charset=utf-8", known))
            return
        self._answer(HTTPStatus.OK, make(self.headers.get("Accept", "")))

    def do_HEAD(self) -> None:
        """The head of a page."""
        self.do_GET()

    def _answer(self, status: HTTPStatus, page: Page) -> None:
        self.send_response(status)
        self.send_header("Content-Type", page.kind)
        self.send_header("Content-Length", str(len(page.content)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(page.content)

    def log_message(self, *_: object) -> None:
        """Say nothing of requests."""


@contextmanager
def serving(host: str, port: int, feed: Feed) -> Iterator[int]:
    """A web server in a thread; yields its port. Raises OSError where it cannot listen there."""
    with Server(host, port, feed) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield server.server_address[1]
        finally:
            server.shutdown()
            thread.join()


def run_feed(
    connection: zenoh_config.Connection,
    host: str,
    port: int,
    tracks: Tracks,
    tell: Callable[[str], None] | None = None,
    url: str = "",
) -> None:
    """Serve what is heard on a router until stopped; waits for one. Raises OSError where it cannot listen there."""
    feed = Feed(tracks)
    with serving(host, port, feed) as bound:
        if tell is not None:
            shown = f"[{host}]" if ":" in host else host
            tell(f"{url or f'http://{shown}:{bound}'} has {', '.join(feed.pages)}")
        # until the session is open, signals just end this process
        with listening(connection, STREAMS, "*", feed.receive, feed.alive, zenoh_config.client), StopSignals() as stop:
            while not stop.wait(FORGET_EVERY_S):
                feed.forget()
