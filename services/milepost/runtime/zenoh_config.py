"""Zenoh configurations as data, so that they can be tested without a session. Reasons: see the comments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

# the priorities that rows of the stream table use, in Zenoh's names for their queues
QUEUES = ("real_time", "interactive_high", "data", "background")
DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
LEASE_MS, OPEN_TIMEOUT_MS = 500, 300
RETRY = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2}


def _base() -> dict[str, Any]:
    return {
        # multicast finds strangers on shared networks; everything here is told where to go
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {
            # a stopped router accepts connections and says nothing: soon the next one is tried
            "unicast": {"open_timeout": OPEN_TIMEOUT_MS},
            "link": {
                "tx": {
                    # a stopped or cut-off process, or router, is noticed after its own lease
                    "lease": LEASE_MS,
                    "keep_alive": 4,
                    # the default queue of 2 loses samples at 1 kHz after a stall
                    "queue": {"size": dict.fromkeys(QUEUES, 16), "congestion_control": {"drop": {"wait_before_drop": 20000}}},
                }
            },
            "shared_memory": {"enabled": False},
        },
    }


def client(endpoints: list[str]) -> dict[str, Any]:
    """A service's session: a client of one router, or of several for failover, that waits until one is there."""
    return {"mode": "client", "connect": {"endpoints": endpoints, "timeout_ms": -1, "retry": dict(RETRY)}, **_base()}


def tool(endpoints: list[str], timeout_ms: int = 2000) -> dict[str, Any]:
    """A tool's session: like a service's, but it gives up soon where no router is."""
    config = client(endpoints)
    config["connect"]["timeout_ms"] = timeout_ms
    config["connect"]["exit_on_failure"] = True
    return config


def router(listen: list[str], link: Sequence[str] = ()) -> dict[str, Any]:
    """A site's router, linked with others: clients of one hear those of the others. It does not wait for them.

    It drops what is larger than its stream allows. It limits no rates: Zenoh can only thin out to a least time between two
    messages of a connection, which loses what comes at once after a stall. Subscribers limit them: see `flood`.
    """
    config = {"mode": "router", "listen": {"endpoints": listen}, "low_pass_filter": _size_limits(), **_base()}
    if link:
        config["connect"] = {"endpoints": list(link), "timeout_ms": -1, "exit_on_failure": False, "retry": dict(RETRY)}
    return config


def _size_limits() -> list[dict[str, Any]]:
    """One filter for each size in the stream table."""
    # the messages take a while to import, and the command line needs this module at once
    from milepost_schemas import STREAMS

    keys: dict[int, dict[str, None]] = {}
    for row in STREAMS:
        keys.setdefault(row.largest_bytes, {})[row.key_for("*")] = None
    each = {"messages": ["put"], "flows": ["ingress"]}
    return [{"id": f"at-most-{size}-bytes", **each, "size_limit": size, "key_exprs": list(keys[size])} for size in sorted(keys)]
