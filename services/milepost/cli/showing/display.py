"""The process that shows trains for `milepost up`: who has come, then the live table, or lines where there is no terminal."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from typing import Literal

from milepost.runtime import zenoh_config
from milepost.runtime.instances import Token
from milepost.runtime.listening import listening
from milepost.runtime.logs.records import say, set_up_log
from milepost.runtime.stop_signals import StopSignals
from milepost_schemas import FusedState, Message

from .arrivals import Arrivals

# `start`: only who has come, until the first states; `lines`: a state a second as well; `table`: the live table
Mode = Literal["start", "lines", "table"]
READ_BYTES = 65536
LOOK_EVERY_S = 0.2


def run_display(
    connection: zenoh_config.Connection, trains: Sequence[str], expected: Sequence[str], mode: Mode, began_ns: int
) -> None:
    """Show trains until stopped. In a table, what comes on standard input is shown line by line."""

    set_up_log("display")

    def age_s() -> float:
        return (time.time_ns() - began_ns) * 1e-9

    if mode == "start":
        _show_start(connection, trains, Arrivals(expected, trains, say, age_s))
        return
    # what draws a table takes a while to import
    from .watch import STREAMS, Screen, show

    screen = Screen()
    arrivals = screen.arrivals = Arrivals(expected, trains, screen.say if mode == "table" else say, age_s)

    def receive(stream: str, message: Message, now_ns: int) -> None:
        if message.train not in trains:  # others may run on the same router
            return
        if isinstance(message, FusedState):
            arrivals.state(message.train)
        screen.receive(stream, message, now_ns)

    def alive(token: Token, there: bool) -> None:
        if there:
            arrivals.came(token.unit, token.train)
        if token.train in trains:
            screen.alive(token, there)

    # until the session is open, SIGTERM just ends this process
    with listening(connection, STREAMS, _any(trains), receive, alive, zenoh_config.client), StopSignals() as stop:
        arrivals.came("router")

        def going() -> bool:
            if mode == "table":
                for sentence in _sentences():
                    screen.say(sentence)
            return not stop.asked

        show(screen, going, stop.wait)


def _any(trains: Sequence[str]) -> str:
    """The part of a key for one train, or for all where there are several."""
    return trains[0] if len(trains) == 1 else "*"


def _show_start(connection: zenoh_config.Connection, trains: Sequence[str], arrivals: Arrivals) -> None:
    def receive(stream: str, message: Message, now_ns: int) -> None:  # noqa: ARG001
        arrivals.state(message.train)

    def alive(token: Token, there: bool) -> None:
        if there:
            arrivals.came(token.unit, token.train)

    with listening(connection, ["state"], _any(trains), receive, alive, zenoh_config.client), StopSignals() as stop:
        arrivals.came("router")
        while not arrivals.done and not stop.wait(LOOK_EVERY_S):
            pass


def _sentences() -> list[str]:
    """What has come on standard input since the last time."""
    os.set_blocking(0, False)
    try:
        return os.read(0, READ_BYTES).decode(errors="replace").splitlines()
    except BlockingIOError:
        return []
