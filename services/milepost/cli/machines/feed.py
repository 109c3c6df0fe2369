"""`milepost feed`: metrics, vehicle positions and GeoJSON of the trains on a router, over HTTP."""

from __future__ import annotations

import signal
from collections.abc import Callable, Sequence
from pathlib import Path

from milepost.cli.endpoint import port_is_free
from milepost.cli.say import say
from milepost.config.errors import ConfigError
from milepost.config.line_tracks import LineTracks
from milepost.runtime.logs.records import set_up_log
from milepost.runtime.zenoh_config import Connection


def check_feed(host: str, port: int, command: str, option: str) -> None:
    """Raises ConfigError where the libraries are missing or nothing can listen on a port."""
    try:
        import google.transit.gtfs_realtime_pb2  # noqa: F401
        import prometheus_client  # noqa: F401
    except ImportError as error:
        text = f"needs prometheus-client and gtfs-realtime-bindings: pip install 'milepost[metrics]' ({error})"
        raise ConfigError(command, option, text) from error
    check_port(host, port, command, option)


def check_port(host: str, port: int, command: str, option: str) -> None:
    """Raises ConfigError where nothing can listen on a port."""
    place = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
    try:
        free = port_is_free(f"tcp/{place}")
    except ValueError as error:
        raise ConfigError(command, option, str(error)) from error
    if not free:
        raise ConfigError(command, option, f"{place} is in use")


def feed_body(
    connection: Connection,
    host: str,
    port: int,
    lines: Sequence[Path],
    tell: Callable[[str], None] | None = None,
    url: str = "",
) -> None:
    """Serve until stopped. Raises ConfigError for a line file that cannot be used."""
    from milepost.runtime.web.feed_server import run_feed

    set_up_log("feed")
    run_feed(connection, host, port, LineTracks(lines, say), tell, url)


def run_feed_command(connection: Connection, host: str, port: int, lines: Sequence[Path], url: str = "") -> int:
    """`milepost feed`. Raises ConfigError."""
    set_up_log("feed")
    check_feed(host, port, "feed", "--port")
    # opening a session waits inside Zenoh, where Python cannot see a signal
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    feed_body(connection, host, port, lines, say, url)
    return 0
