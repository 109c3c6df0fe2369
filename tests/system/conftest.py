"""A real train: real router, real processes, a real session outside."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import msgpack
import pytest
import zenoh

from milepost.chaos.news import News
from milepost.chaos.running import RunningTrain as Stack
from milepost.chaos.running import free_port as free_port
from milepost.chaos.running import title_of as title_of
from milepost.offline.collector import no_collection

pytestmark = pytest.mark.system


def pytest_collection_modifyitems(items):
    for item in items:
        if "/system/" in str(item.path):
            item.add_marker(pytest.mark.system)


class Outside:
    """A dispatch tool: plain eclipse-zenoh and msgpack, nothing of Milepost's."""

    def __init__(self, *endpoints: str, config: dict | None = None) -> None:
        config = config or {
            "mode": "client",
            "connect": {"endpoints": list(endpoints), "timeout_ms": 20000},
            "scouting": {"multicast": {"enabled": False}},
            # of two routers one that hangs is given up as soon as by the train's own processes
            "transport": {"unicast": {"open_timeout": 300}, "link": {"tx": {"lease": 500, "keep_alive": 4}}},
        }
        self.session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
        # a search for cycles in all that is kept takes up to a second, which would be measured as a gap in what is heard
        self._measures = ExitStack()
        self._measures.enter_context(no_collection())
        self.news = News()
        # other ones for each new key: who looks at one meanwhile is not disturbed
        self.heard: dict[str, list[tuple[int, dict]]] = {}
        self.tokens: dict[str, bool] = {}
        self._keys = threading.Lock()
        self._kept = []

    def listen(self, key: str) -> None:
        def receive(sample):
            try:
                entry = (time.time_ns(), msgpack.unpackb(sample.payload.to_bytes()))
            except ValueError:  # the garbage that a test puts comes back to it
                return
            on = str(sample.key_expr)
            if on not in self.heard:
                with self._keys:
                    self.heard = {on: [], **self.heard}
            self.heard[on].append(entry)
            self.news.heard()

        self._kept.append(self.session.declare_subscriber(key, receive))

    def watch_tokens(self, key: str) -> None:
        def changed(sample):
            with self._keys:
                self.tokens = {**self.tokens, str(sample.key_expr): sample.kind == zenoh.SampleKind.PUT}
            self.news.heard()

        self._kept.append(self.session.liveliness().declare_subscriber(key, changed, history=True))

    def messages(self, key: str) -> list[dict]:
        return [message for _, message in self.heard.get(key, [])]

    def newest(self, key: str) -> dict:
        """The last message on a key; empty where there was none."""
        heard = self.heard.get(key)
        return heard[-1][1] if heard else {}

    def there(self, key: str) -> dict:
        """The last message on a key, once there is one: on a busy machine a process may be late with its first."""
        self.wait_for(lambda: self.heard.get(key), 20.0, f"a message on {key}")
        return self.newest(key)

    def wait_for(self, what: Callable[[], object], timeout_s: float, why: str) -> object:
        """Wait until `what()` is true; what came is looked at whenever something comes."""
        found: object = self.news.wait_for(what, timeout_s, why)
        return found

    def wait_state(self, key: str, accept: Callable[[dict], bool], timeout_s: float, why: str) -> dict:
        """The first state from now on that `accept` takes."""
        begin = len(self.heard.get(key, []))

        def found():
            return next((m for _, m in self.heard.get(key, [])[begin:] if accept(m)), None)

        return self.wait_for(found, timeout_s, why)  # type: ignore[return-value]

    def close(self) -> None:
        self._kept.clear()
        self.session.close()
        self._measures.close()


def width_m(state: dict) -> float:
    """How wide a state's interval of the position is."""
    return state["position_max_m"] - state["position_min_m"]


def widest_m(before: dict, first: dict) -> float:
    """How wide the first state of a fuser may be that continues from the state `before`, even if it heard no reading since.

    Meanwhile the train moves no harder than white jerk of q = 50 m²/s⁵ drives it: 3 σ on either side, with σ² = q t⁵ / 20.
    """
    gap_s = (first["measured_at_ns"] - before["measured_at_ns"]) / 1e9
    return width_m(before) + 1.0 + 6.0 * math.sqrt(50.0 * gap_s**5 / 20.0)


def start(train: str, *options: str) -> tuple[Stack, Outside]:
    stack = Stack(train, *options)
    try:
        outside = Outside(*stack.endpoints)
    except zenoh.ZError:  # on a machine that is too busy: a train must not stay behind
        stack.stop()
        raise
    outside.listen("milepost/v1/**")
    outside.listen("milepost/v1/*/@sim/truth")
    outside.watch_tokens("milepost/v1/*/alive/**")
    return stack, outside


@contextmanager
def running(train: str, state: str, *options: str) -> Iterator[tuple[Stack, Outside]]:
    """A train that is normal, by its key `state`, and that ends in order after the block."""
    stack, outside = start(train, *options)
    try:
        outside.wait_state(state, lambda m: m["status"] == "normal", 40.0, "a normal state")
        yield stack, outside
    finally:
        outside.close()
        code = stack.stop()
    assert code == 0, "".join(stack.errors)


@pytest.fixture(scope="module")
def maglev() -> Iterator[tuple[Stack, Outside]]:
    """The maglev train, running; a test finds it normal and leaves it so."""
    with running("deploy/trains/maglev.yaml", "milepost/v1/maglev-1/state") as train:
        yield train


@pytest.fixture
def router() -> Iterator[str]:
    """A router alone, that listens; yields its endpoint."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    command = [sys.executable, "-m", "milepost", "run", "router", "--listen", endpoint, "--parent", str(os.getpid())]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stderr is not None
        assert any("listening on" in line for line in process.stderr), "it ended before it listened"
        yield endpoint
    finally:
        process.send_signal(signal.SIGTERM)
        assert process.wait(5.0) == 0
