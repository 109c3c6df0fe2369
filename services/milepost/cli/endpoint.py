"""Endpoints of the embedded router."""

from __future__ import annotations

import errno
import socket


def port_is_free(endpoint: str) -> bool:
    """Whether a tcp/HOST:PORT endpoint can be listened on. Raises ValueError for what is not one."""
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    if not (endpoint.startswith("tcp/") and host and port.isdecimal() and int(port) < 2**16):
        raise ValueError(f"{endpoint!r} is not tcp/HOST:PORT")
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host.strip("[]"), int(port)))
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise ValueError(f"cannot listen on {endpoint}: {error.strerror}") from error
            return False
    return True
