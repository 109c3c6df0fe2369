"""One process of the operating system that runs whole trains, from beginning to end."""

from __future__ import annotations

import queue
import signal
from collections.abc import Sequence
from contextlib import ExitStack

from milepost.offline.collector import rare_collection
from milepost.runtime import zenoh_config
from milepost.runtime.bus import open_session
from milepost.runtime.logs.output import zenoh_in_log
from milepost.runtime.logs.records import set_up_log
from milepost.runtime.process import ProcessOptions
from milepost.runtime.stop_signals import STOPPING

from .aboard import Aboard, Boarding, Member
from .loop import Loop

NAME = "together"


def run_together(boardings: Sequence[Boarding], options: ProcessOptions) -> bool:
    """Run trains, each with all its processes, until stopped or until all have ended; whether stopped. Raises ConfigError.

    What a node raises ends the process, after an event has said so.
    """
    set_up_log(NAME, boardings[0].train.name if len(boardings) == 1 else "", several=len(boardings) == 1)
    ready: queue.SimpleQueue[int] = queue.SimpleQueue()
    # opening waits for a router inside Zenoh, where Python cannot see a signal
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    with zenoh_in_log(), open_session(zenoh_config.client(options.connection)) as session, ExitStack() as announced:
        trains, labels = list[Aboard](), 0
        for boarding in boardings:
            trains.append(Aboard(boarding, session, labels, ready))
            labels += len(trains[-1].members)
        _stop_on_signals(trains)
        for train in trains:
            train.appear()
        if not all(train.wait() for train in trains):
            return True
        for train in trains:
            train.begin(options.speed, announced)
        return _run(trains, ready, options)


def _run(trains: Sequence[Aboard], ready: queue.SimpleQueue[int], options: ProcessOptions) -> bool:
    places = [(train, member) for train in trains for member in train.members]
    seats = [
        member.seat(train.start, options.parent, options.state_dir, number / len(places))
        for number, (train, member) in enumerate(places)
    ]
    with rare_collection():
        stopped = _loop(Loop(seats, ready), places)
    for _, member in places:
        member.end()
    return stopped


def _loop(loop: Loop, places: Sequence[tuple[Aboard, Member]]) -> bool:
    """Until stopped, or until all are over; whether stopped."""
    left = len(places)
    while left:
        over = loop.step()
        if over is None:
            return True
        for label in over:
            train, member = places[label]
            train.over(member)
            left -= 1
    return False


def _stop_on_signals(trains: Sequence[Aboard]) -> None:
    def stop(*_: object) -> None:
        for train in trains:
            train.stop()

    for number in STOPPING:
        signal.signal(number, stop)
