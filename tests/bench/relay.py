"""The raw chain beside which the train is measured: source → relay → relay → sink through one router, nothing but Zenoh.

Each process has the shape of ours (client mode, callback to queue to main thread) and sends payloads of the size of ours.
Usage: relay.py ENDPOINT source|relay FROM TO
"""

from __future__ import annotations

import json
import queue
import signal
import struct
import sys
import time

import zenoh

from milepost.runtime.zenoh_config import client

SIZE = 330
PERIOD_S = 0.02


def main(endpoint: str, kind: str, origin: str, target: str) -> None:
    running = [True]
    signal.signal(signal.SIGTERM, lambda *_: running.__setitem__(0, False))
    with zenoh.open(zenoh.Config.from_json5(json.dumps(client([endpoint])))) as session:
        drop = zenoh.CongestionControl.DROP
        publisher = session.declare_publisher(target, congestion_control=drop, express=True)
        if kind == "source":
            due = time.monotonic()
            while running[0]:
                due += PERIOD_S
                time.sleep(max(0.0, due - time.monotonic()))
                publisher.put(struct.pack("q", time.time_ns()).ljust(SIZE, b"\0"))
            return
        inbox: queue.SimpleQueue = queue.SimpleQueue()
        subscriber = session.declare_subscriber(origin, (inbox.put, inbox))
        while running[0]:
            try:
                sample = inbox.get(timeout=0.5)
            except queue.Empty:
                continue
            publisher.put(sample.payload.to_bytes())
        subscriber.undeclare()


if __name__ == "__main__":
    main(*sys.argv[1:])
