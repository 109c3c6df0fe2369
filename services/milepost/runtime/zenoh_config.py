"""Zenoh configurations as data, so that they can be tested without a session. Reasons: see the comments."""

from __future__ import annotations

from typing import Any

# the priorities that rows of the stream table use, in Zenoh's names for their queues
QUEUES = ("real_time", "interactive_high", "data", "background")
DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"


def _base() -> dict[str, Any]:
    return {
        # multicast finds strangers on shared networks; everything here is told where to go
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {
            "link": {
                "tx": {
                    # a stopped or cut-off process is noticed after its own lease: 1 s
                    "lease": 1000,
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
    connect = {
        "endpoints": endpoints,
        "timeout_ms": -1,
        "retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2},
    }
    return {"mode": "client", "connect": connect, **_base()}


def tool(endpoints: list[str], timeout_ms: int = 2000) -> dict[str, Any]:
    """A tool's session: like a service's, but it gives up soon where no router is."""
    config = client(endpoints)
    config["connect"]["timeout_ms"] = timeout_ms
    config["connect"]["exit_on_failure"] = True
    return config


def router(listen: list[str]) -> dict[str, Any]:
    """The site's router."""
    return {"mode": "router", "listen": {"endpoints": listen}, **_base()}
