"""A stranger that floods one key from a process of its own: `python flood.py ENDPOINT KEY HZ SECONDS KIND`.

KIND: `random` bytes; `map`, which is msgpack, but no message; `replay`, a message that was heard on the key, over and over.
It prints how many messages it has put and in how many seconds.
"""

from __future__ import annotations

import json
import os
import sys
import time

import msgpack
import zenoh

RANDOM = [os.urandom(64) for _ in range(256)]
MAP = [msgpack.packb({"train": "t", "unit": "u", "sequence": i, "speed_mps": "fast"}) for i in range(256)]


def payloads(session: zenoh.Session, key: str, kind: str) -> list[bytes]:
    if kind != "replay":
        return {"random": RANDOM, "map": MAP}[kind]
    with session.declare_subscriber(key) as heard:
        return [heard.recv().payload.to_bytes()]


def flood(endpoint: str, key: str, rate_hz: float, seconds: float, kind: str) -> tuple[int, float]:
    config = {
        "mode": "client",
        "connect": {"endpoints": [endpoint], "timeout_ms": 20000},
        "scouting": {"multicast": {"enabled": False}},
    }
    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
        garbage = payloads(session, key, kind)
        publisher = session.declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP)
        begun, count = time.monotonic(), 0
        while (spent := time.monotonic() - begun) < seconds:
            # what is due by now, as a burst: a sleep for each message would be longer than its period
            due = int(spent * rate_hz)
            while count < due:
                publisher.put(garbage[count % len(garbage)])
                count += 1
            time.sleep(0.001)
        return count, time.monotonic() - begun


if __name__ == "__main__":
    endpoint, key, rate_hz, seconds, kind = sys.argv[1:]
    count, spent = flood(endpoint, key, float(rate_hz), float(seconds), kind)
    print(f"{count} {spent:.3f}")
