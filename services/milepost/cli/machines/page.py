"""The dispatch page, a web server for people."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from milepost.config.errors import ConfigError
from milepost.config.line_tracks import KnownLines
from milepost.runtime.logs.records import say
from milepost.runtime.zenoh_config import Connection

if TYPE_CHECKING:
    from milepost.page.injecting import Answer, Order


def needs(command: str, option: str) -> None:
    """Raises ConfigError where the library is missing."""
    if find_spec("nicegui") is None:
        raise ConfigError(command, option, "needs nicegui: pip install 'milepost[page]'")


def serve(
    connection: Connection, host: str, port: int, lines: Sequence[Path], tell: Callable[[str], None] | None, url: str
) -> None:
    """Serve until stopped. Raises ConfigError for a line file that cannot be used."""
    from milepost.runtime.web.page_server import run_page

    run_page(connection, host, port, KnownLines(lines, say), lambda order: _send(connection, order), tell, url)


def _send(connection: Connection, order: Order) -> Answer:
    """What `milepost inject` does, with the answer for a page."""
    from milepost.cli.inject import Wanted, fields_of
    from milepost.page.injecting import Answer
    from milepost.runtime.bus import NoRouterError
    from milepost.runtime.injecting.commands import NoAnswerError, send_command

    wanted = Wanted(order.unit, order.fault, order.options, order.for_s, not order.fault, order.train)
    try:
        answer = send_command(connection, order.train, order.unit, fields_of(wanted))
    except (ConfigError, NoRouterError, NoAnswerError) as error:
        return Answer(False, str(error))
    return Answer(answer.code != "fault_refused", answer.text.rpartition(" (")[0])
