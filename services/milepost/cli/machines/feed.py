"""The feed: metrics, vehicle positions and GeoJSON of the trains on a router, over HTTP."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from milepost.config.errors import ConfigError
from milepost.config.line_tracks import LineTracks
from milepost.runtime.logs.records import say
from milepost.runtime.zenoh_config import Connection


def needs(command: str, option: str) -> None:
    """Raises ConfigError where the libraries are missing."""
    try:
        import google.transit.gtfs_realtime_pb2  # noqa: F401
        import prometheus_client  # noqa: F401
    except ImportError as error:
        text = f"needs prometheus-client and gtfs-realtime-bindings: pip install 'milepost[metrics]' ({error})"
        raise ConfigError(command, option, text) from error


def serve(
    connection: Connection, host: str, port: int, lines: Sequence[Path], tell: Callable[[str], None] | None, url: str
) -> None:
    """Serve until stopped. Raises ConfigError for a line file that cannot be used."""
    from milepost.runtime.web.feed_server import run_feed

    run_feed(connection, host, port, LineTracks(lines, say), tell, url)
