"""Zenoh configurations as data, so that they can be tested without a session. Reasons: see the comments."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

# the priorities that rows of the stream table use, in Zenoh's names for their queues
QUEUES = ("real_time", "interactive_high", "data", "background")
DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
LEASE_MS, OPEN_TIMEOUT_MS = 500, 300
# the endpoints of routers, or the file of a whole session configuration
Connection = list[str] | Path
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


def client(connection: Connection) -> dict[str, Any]:
    """A service's session: a client of one router, or of several for failover, that waits until one is there.

    What a file of a session configuration says goes before what stands here. Raises ConfigError.
    """
    return _with_file(connection, {"timeout_ms": -1})


def tool(connection: Connection, timeout_ms: int = 2000) -> dict[str, Any]:
    """A tool's session: like a service's, but it gives up soon where no router is. Raises ConfigError."""
    return _with_file(connection, {"timeout_ms": timeout_ms, "exit_on_failure": True})


def place(connection: Connection) -> str:
    """Where a connection leads, for people."""
    return f"the endpoints of {connection}" if isinstance(connection, Path) else ", ".join(connection)


def as_options(connection: Connection) -> list[str]:
    """A connection as options of a command."""
    if isinstance(connection, Path):
        return ["--zenoh-config", str(connection)]
    return [word for endpoint in connection for word in ("--connect", endpoint)]


def _with_file(connection: Connection, waits: dict[str, Any]) -> dict[str, Any]:
    endpoints = [] if isinstance(connection, Path) else connection
    config = {"mode": "client", "connect": {"endpoints": endpoints, **waits, "retry": dict(RETRY)}, **_base()}
    if not isinstance(connection, Path):
        return config
    # commands that only need the default endpoint are not to wait for Zenoh
    from .sessions.session_file import laid_over

    return laid_over(config, connection)


def router(listen: list[str], link: Sequence[str] = ()) -> dict[str, Any]:
    """A site's router, linked with others: clients of one hear those of the others. It does not wait for them.

    It drops what is larger than its stream allows. It limits no rates: Zenoh can only thin out to a least time between two
    messages of a connection, which loses what comes at once after a stall. Subscribers limit them: see `flood`.
    """
    config = {"mode": "router", "listen": {"endpoints": listen}, "low_pass_filter": _size_limits(), **_base()}
    if link:
        config["connect"] = {"endpoints": list(link), "timeout_ms": -1, "exit_on_failure": False, "retry": dict(RETRY)}
    return config


def listening_certificate(config: dict[str, Any]) -> Path | None:
    """The certificate that a router shows; None where it listens without."""
    named = config["transport"]["link"].get("tls", {}).get("listen_certificate")
    return Path(named) if named else None


def _size_limits() -> list[dict[str, Any]]:
    """One filter for each size in the stream table."""
    # the messages take a while to import, and the command line needs this module at once
    from milepost_schemas import STREAMS

    keys: dict[int, dict[str, None]] = {}
    for row in STREAMS:
        keys.setdefault(row.largest_bytes, {})[row.key_for("*")] = None
    each = {"messages": ["put"], "flows": ["ingress"]}
    return [{"id": f"at-most-{size}-bytes", **each, "size_limit": size, "key_exprs": list(keys[size])} for size in sorted(keys)]
