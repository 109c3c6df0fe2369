"""Simulated time has one owner: `world` says when scenario time began; everybody else waits for it."""

from __future__ import annotations

import logging
import queue
import time
from collections.abc import Callable, Collection, Sequence
from typing import Any

from milepost.nodes.base import Severity
from milepost.nodes.catching_up.agreement import most_told
from milepost_schemas import SimulationStart, encode, rpc_key, simulation_start_key

from .bus import AliveChange, Stop, ZenohBus
from .inbox.taking import take
from .instances import Instances

log = logging.getLogger("milepost")
Tell = Callable[[Severity, str, str], None]
LEAD_NS = 1_000_000_000
GRID_NS = 100_000_000
ASK_EVERY_S = 0.1
SAY_WAITING_EVERY_S = 5.0
WAIT_FOR_OTHERS_S = 30.0
ASK_OTHERS_S, ASK_WORLD_S = 0.5, 1.0
REMEMBERED = "simulation_start"


def wait_for_processes(
    bus: ZenohBus,
    names: set[str],
    tell: Tell,
    say_every_s: float = SAY_WAITING_EVERY_S,
    give_up_after_s: float = WAIT_FOR_OTHERS_S,
) -> bool:
    """Wait until every named process shows its token, so that nobody misses the beginning. Returns False when stopped.

    `tell(severity, code, text)` is called with the names of those that are missing, and of those that it begins without.
    """
    tokens = bus.watch_tokens()
    try:
        return _wait(bus, names, tell, say_every_s, give_up_after_s)
    finally:
        tokens.undeclare()


def _wait(bus: ZenohBus, names: set[str], tell: Tell, say_every_s: float, give_up_after_s: float) -> bool:
    there = Instances()
    begun = said = time.monotonic()
    while missing := sorted(name for name in names if not there.live(bus.train, name)):
        now = time.monotonic()
        if now - begun >= give_up_after_s:
            tell("warning", "began_without", f"beginning without {', '.join(missing)}")
            return True
        if now - said >= say_every_s:
            said = now
            tell("info", "waiting_for", f"waiting for {', '.join(missing)} ({now - begun:.0f} s)")
        try:
            item = take(bus.inbox, min(said + say_every_s, begun + give_up_after_s) - now)
        except queue.Empty:
            continue
        if isinstance(item, Stop):
            return False
        if isinstance(item, AliveChange):
            there.changed(item.token, item.alive, now)
    return True


def choose_start(length_s: float, speed: float) -> SimulationStart:
    """Scenario time 0 shortly from now, on a round tenth of a second."""
    start = (time.time_ns() + LEAD_NS) // GRID_NS * GRID_NS + GRID_NS
    return SimulationStart(start_ns=start, speed=speed, end_ns=start + round(length_s * 1e9))


def announce(bus: ZenohBus, start: SimulationStart) -> Any:
    """Answer whoever asks when scenario time began. Keep what it returns."""
    return _answer(bus, simulation_start_key(bus.train), start)


def remember(bus: ZenohBus, name: str, start: SimulationStart) -> Any:
    """Answer a `world` that was restarted, and asks when scenario time began. Keep what it returns."""
    return _answer(bus, rpc_key(bus.train, REMEMBERED, name), start)


def remembered(bus: ZenohBus, known: Collection[str]) -> SimulationStart | None:
    """When scenario time began, if other processes remember it: `world` was restarted, and the train runs on.

    `known` are the names of the train's processes: what most of them say counts, whatever a stranger says.
    """
    return most_told(bus.ask(rpc_key(bus.train, REMEMBERED), SimulationStart, ASK_OTHERS_S), known)


def _answer(bus: ZenohBus, key: str, start: SimulationStart) -> Any:
    payload = encode(start)

    def answer(query: Any) -> None:
        with query:
            query.reply(key, payload)

    return bus.session.declare_queryable(key, answer)


def wait_for_start(bus: ZenohBus, known: Collection[str]) -> SimulationStart | None:
    """Ask until `world` answers. Returns None when stopped meanwhile; what else came stays in the inbox.

    Where several answers differ, or none is `world`'s, that counts which most of the processes `known` remember.
    """
    kept: list[Any] = []
    try:
        return _ask_until_answered(bus, known, kept)
    finally:
        for item in kept:
            bus.inbox.put(item)


def _ask_until_answered(bus: ZenohBus, known: Collection[str], kept: list[Any]) -> SimulationStart | None:
    begun = said = time.monotonic()
    while True:
        start = _believed(bus, known)
        if start is not None:
            return start
        if time.monotonic() - said > SAY_WAITING_EVERY_S:
            said = time.monotonic()
            log.warning("waiting for `world` to say when scenario time began (%.0f s)", said - begun)
        try:
            item = take(bus.inbox, ASK_EVERY_S)
            if isinstance(item, Stop):
                return None
            kept.append(item)
        except queue.Empty:
            continue


def _believed(bus: ZenohBus, known: Collection[str]) -> SimulationStart | None:
    """What `world` answers; where a stranger answers too, or `world` does not, what those remember that started before."""
    told = [("world", start) for _, start in bus.ask(simulation_start_key(bus.train), SimulationStart, ASK_WORLD_S)]
    others = bus.ask(rpc_key(bus.train, REMEMBERED), SimulationStart, ASK_OTHERS_S)
    if not told:
        return _of_most(others, known)
    if len({start for _, start in told}) > 1 and not any(name in known for name, _ in others):
        log.error("several processes say, each differently, when scenario time began: end all but one `world`")
        return None
    return most_told([*told, *others], known)


def _of_most(others: Sequence[tuple[str, SimulationStart]], known: Collection[str]) -> SimulationStart | None:
    """What more than half of the train's processes say; None where they are fewer: then the train may just be beginning.

    A router that was replaced may hand on the questions to all processes but `world`, for as long as both run.
    """
    best = most_told(others, known)
    agreeing = {name for name, start in others if name in known and start == best}
    return best if 2 * len(agreeing) > len(known) else None
