"""The process that shows a train for `milepost up`: who has come, then the live table, or lines where there is no terminal."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from typing import Literal

from milepost.runtime import zenoh_config
from milepost.runtime.instances import Token
from milepost.runtime.listening import listening
from milepost.runtime.stop_signals import StopSignals
from milepost_schemas import FusedState, Message

from .arrivals import Arrivals
from .watch import STREAMS, Screen, show

# `start`: only who has come, until the first state; `lines`: a state a second as well; `table`: the live table
Mode = Literal["start", "lines", "table"]
READ_BYTES = 65536


def run_display(endpoint: str, train: str, expected: Sequence[str], mode: Mode, began_ns: int) -> None:
    """Show a train until stopped. In a table, what comes on standard input is shown line by line."""
    screen = Screen()

    def say(sentence: str) -> None:
        if mode == "table":
            screen.say(sentence)
        else:
            print(f"milepost: {sentence}", file=sys.stderr, flush=True)

    arrivals = Arrivals(["router", *expected], say, lambda: (time.time_ns() - began_ns) * 1e-9)
    screen.arrivals = arrivals

    def receive(stream: str, message: Message, now_ns: int) -> None:
        if isinstance(message, FusedState):
            arrivals.state()
        screen.receive(stream, message, now_ns)

    def alive(token: Token, there: bool) -> None:
        if there:
            arrivals.came(token.unit)
        screen.alive(token, there)

    # until the session is open, SIGTERM just ends this process
    with listening([endpoint], STREAMS, train, receive, alive, zenoh_config.client), StopSignals() as stop:
        arrivals.came("router")

        def going() -> bool:
            if mode == "table":
                _read_sentences(screen)
            return not stop.asked and not (mode == "start" and arrivals.done)

        show(screen, going, stop.wait, states=mode != "start")


def _read_sentences(screen: Screen) -> None:
    os.set_blocking(0, False)
    try:
        text = os.read(0, READ_BYTES).decode(errors="replace")
    except BlockingIOError:
        return
    for sentence in text.splitlines():
        screen.say(sentence)
