"""Why no session could be opened, as far as this side can tell."""

from __future__ import annotations

import socket
from collections.abc import Sequence

PROBE_S = 0.5
HOW_TO_START = "start one with `milepost up` or `milepost run router`, at another endpoint with `--listen`"
HOW_TO_ENTER = (
    "somebody listens there, and takes no session: a secure train needs `--zenoh-config` with a certificate of its own"
)


def advice(endpoints: Sequence[str]) -> str:
    """What to do where no session could be opened: start a router, or show what the one that is there asks for."""
    return HOW_TO_ENTER if any(_listens(endpoint) for endpoint in endpoints) else HOW_TO_START


def _listens(endpoint: str) -> bool:
    """Whether somebody takes a TCP connection at a tcp/HOST:PORT or tls/HOST:PORT."""
    host, _, port = endpoint.partition("/")[2].partition("?")[0].rpartition(":")
    if not (host and port.isdecimal()):
        return False
    try:
        with socket.create_connection((host.strip("[]"), int(port)), PROBE_S):
            return True
    except (OSError, OverflowError):
        return False
