"""Pairs of linked routers that both stand still and go on: how long until everybody hears everybody, and how often never.

`python -m tests.bench.reconnects --pairs 6 --stops 20`. Many sessions in one process make late what Zenoh does after a stop.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from milepost.chaos.running import free_port
from milepost.runtime.bus import open_session
from milepost.runtime.zenoh_config import client

KEY, SPEAKS_EVERY_S, LONGEST_S = "bench/reconnects", 0.02, 30.0


class Crowd:
    """Sessions of which each says something every 20 ms; `heard` is when which one last heard which other one."""

    def __init__(self, sessions: list[Any]) -> None:
        self.heard: dict[tuple[int, int], float] = {}
        self._count = len(sessions)
        self._over = threading.Event()
        self._kept = [session.declare_subscriber(f"{KEY}/*", self._receive(who)) for who, session in enumerate(sessions)]
        self._publishers = [session.declare_publisher(f"{KEY}/{who}") for who, session in enumerate(sessions)]
        self._speaker = threading.Thread(target=self._speak, daemon=True)
        self._speaker.start()

    def _receive(self, who: int) -> Callable[[Any], None]:
        def receive(sample: Any) -> None:
            self.heard[who, int(str(sample.key_expr).rpartition("/")[2])] = time.monotonic()

        return receive

    def _speak(self) -> None:
        while not self._over.wait(SPEAKS_EVERY_S):
            for publisher in self._publishers:
                publisher.put(bytes(200))

    def all_hear_after_s(self) -> float | None:
        """How long from now on until all have heard all; None where that takes too long."""
        since = time.monotonic()
        while (now := time.monotonic()) < since + LONGEST_S:
            if all(self.heard.get((i, k), 0.0) > since for i in range(self._count) for k in range(self._count)):
                return now - since
            time.sleep(SPEAKS_EVERY_S)
        return None

    def end(self) -> None:
        self._over.set()
        self._speaker.join()


def stop_both(routers: list[int], rng: random.Random) -> None:
    """Both stand still at almost the same time, each for 0.4 to 2 s."""
    rng.shuffle(routers)
    ends = []
    for pid in routers:
        os.kill(pid, signal.SIGSTOP)
        ends.append((time.monotonic() + rng.uniform(0.4, 2.0), pid))
        time.sleep(rng.uniform(0.0, 0.1))
    for at, pid in sorted(ends):
        time.sleep(max(0.0, at - time.monotonic()))
        os.kill(pid, signal.SIGCONT)


def break_pair(seed: int, stops: int, found: list[float | None]) -> None:
    """Two routers and two sessions on each; the pair is given up where somebody stays deaf."""
    rng = random.Random(seed)
    endpoints = [f"tcp/127.0.0.1:{free_port()}" for _ in range(2)]
    with ExitStack() as stack:
        routers = []
        for place, endpoint in enumerate(endpoints):
            words = ["run", "router", "--listen", endpoint, *(["--link", endpoints[0]] if place else [])]
            process = subprocess.Popen([sys.executable, "-m", "milepost", *words])
            stack.callback(process.kill)
            routers.append(process.pid)
        sessions = [stack.enter_context(open_session(client([endpoint]))) for endpoint in endpoints for _ in range(2)]
        crowd = Crowd(sessions)
        stack.callback(crowd.end)
        crowd.all_hear_after_s()
        for _ in range(stops):
            stop_both(routers, rng)
            found.append(crowd.all_hear_after_s())
            if found[-1] is None:
                return


def main() -> None:
    """Break pairs side by side, and print how long it took until all was heard again."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.reconnects", description=__doc__)
    parser.add_argument("--pairs", type=int, default=6)
    parser.add_argument("--stops", type=int, default=20, help="of each pair")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    found: list[float | None] = []
    seeds = [options.seed * 1000 + pair for pair in range(options.pairs)]
    threads = [threading.Thread(target=break_pair, args=(seed, options.stops, found)) for seed in seeds]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    took = sorted(each for each in found if each is not None)
    print(
        json.dumps(
            {
                "stops": len(found),
                "never": found.count(None),
                "longer_than_3_s": sum(each > 3.0 for each in took),
                "median_s": took[len(took) // 2] if took else None,
                "longest_s": took[-1] if took else None,
            }
        )
    )


if __name__ == "__main__":
    main()
