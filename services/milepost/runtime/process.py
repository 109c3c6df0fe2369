"""One process from beginning to end: session, token, scenario time, node, signals."""

from __future__ import annotations

import logging
import os
import queue
import signal
import time
import uuid
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from milepost.config.roles import ROLES
from milepost.config.train import Train
from milepost.estimation.time_units import NS_PER_S
from milepost.nodes.base import Node
from milepost.nodes.world import WorldNode
from milepost.offline.collector import rare_collection
from milepost.sensors.base import World
from milepost_schemas import SimulationStart

from . import scenario_time, zenoh_config
from .bus import Inbox, Stop, ZenohBus, open_session
from .clock import Clock
from .freed_memory import giving_back
from .inbox.taking import take
from .logs.output import zenoh_in_log
from .logs.records import set_up_log
from .runner import Runner
from .sessions.session_file import whole
from .together.part import (
    GRACE_NS,
    Part,
    begin_with_what_is_known,
    declare_alive,
    listen,
    names_of,
    stays,
    wait_for_others,
)
from .zenoh_config import Connection

log = logging.getLogger("milepost")
# a router with a certificate looks so often whether it stood still: for a lease, after which it has lost all its clients
LOOKS_EVERY_S, STOOD_STILL_S = 0.1, zenoh_config.LEASE_MS / 1e3
# any other looks so often whether its parent is still there
PARENT_EVERY_S = 1.0


@dataclass(frozen=True)
class ProcessOptions:
    """What the command line says of a process.

    `state_dir`: where a filter keeps what it learned. `awaits`: processes besides the train's own that `world` waits for.
    `change`: of one of several trains, what is different from its file, as JSON.
    """

    connection: Connection
    speed: float = 1.0
    duration_s: float | None = None
    parent: int | None = None
    state_dir: Path | None = None
    awaits: tuple[str, ...] = ()
    change: str | None = None


def stop_on_signals(inbox: Inbox) -> None:
    """SIGTERM and SIGINT end the process through its inbox, so that the session closes and the token goes."""
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: inbox.put(Stop()))


def run_process(train: Train, role_name: str, unit: str, options: ProcessOptions, world: World | None = None) -> bool:
    """Run one process of a train until it is stopped or its simulation ends; whether it was stopped. Raises ConfigError.

    `world`: the train's, where the caller has built it already.
    """
    role = ROLES[role_name]
    if world is None and role.uses_world and train.file.world is not None:
        world = train.world(options.duration_s)
    part = Part(train, role, unit, world, options.duration_s)
    name = part.name
    set_up_log(name, train.name, options.change is not None)
    # built once before anything is declared, so that a mistake in the configuration shows before anything starts
    node = part.first_node(uuid.uuid4().hex[:8])
    # opening waits for a router inside Zenoh, where Python cannot see a signal
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    with zenoh_in_log(), open_session(zenoh_config.client(options.connection)) as session:
        bus = ZenohBus(session, train.name)
        stop_on_signals(bus.inbox)
        listen(bus, node, name)
        declare_alive(bus, node, name)
        log.debug("there as instance %s, of %s", node.instance, train.path)
        with ExitStack() as announced:
            start: SimulationStart | None = None
            if train.has_scenario_time:
                start = _scenario_start(bus, train, node, name, options, announced)
                if start is None:
                    log.debug("asked to end before scenario time began")
                    return True
            clock = Clock(start)
            node = part.node_in_time(node, start, clock)
            runner = part.runner(node, bus, clock, start, options.parent)
            log.debug("begins, at %.2f s of scenario time", _scenario_s(clock, start))
            stopped = _run(runner, bus, node, clock, train, options.state_dir)
            log.debug("asked to end" if stopped else "has nothing more to do")
            if not stopped and stays(node, start, clock) and start is not None:
                _stay(bus.inbox, clock, start.end_ns + 2 * GRACE_NS)
            return stopped


def _scenario_s(clock: Clock, start: SimulationStart | None) -> float:
    return (clock.now_ns() - start.start_ns) / NS_PER_S if start is not None else 0.0


def _run(runner: Runner, bus: ZenohBus, node: Node, clock: Clock, train: Train, state_dir: Path | None) -> bool:
    """Begin with what is known, run to the end, keep what was learned; whether it was stopped."""
    store = begin_with_what_is_known(runner, bus, node, clock, train, state_dir)
    with rare_collection():
        stopped = runner.run()
    if store is not None:
        store.write()
    return stopped


def _stay(inbox: Inbox, clock: Clock, until_ns: int) -> None:
    """Keep the token until a time, or until stopped; what comes meanwhile is left unread."""
    while (left_s := clock.wait_s(until_ns)) > 0.0:
        try:
            if isinstance(take(inbox, left_s), Stop):
                return
        except queue.Empty:
            return


def _scenario_start(
    bus: ZenohBus, train: Train, node: Node, name: str, options: ProcessOptions, announced: ExitStack
) -> SimulationStart | None:
    """When scenario time begins: `world` says it once all others are there, and answers until `announced` is closed.

    None if stopped meanwhile. A `world` that was restarted asks the others, who remember it.
    """
    if not isinstance(node, WorldNode):
        told = scenario_time.wait_for_start(bus, names_of(train))
        if told is not None:
            announced.callback(scenario_time.remember(bus, name, told).undeclare)
        return told
    start = scenario_time.remembered(bus, names_of(train))
    if start is None:
        if not wait_for_others(bus, train, node, options.awaits):
            return None
        start = scenario_time.choose_start(node.end_s, options.speed)
    announced.callback(scenario_time.announce(bus, start).undeclare)
    return start


def run_router(
    listen: list[str],
    config_file: Path | None,
    parent: int | None = None,
    link: Sequence[str] = (),
    zenoh_log: str = "error",
    attend: Callable[[Any], AbstractContextManager[None]] | None = None,
    name: str = "router",
) -> None:
    """Run a Zenoh router, linked with others, until stopped, or until `parent` is no longer its parent.

    `attend` does something with its session as long as that is open, and with what Zenoh writes. `name`: of several, which one.
    """
    set_up_log(name)
    inbox: Inbox = queue.SimpleQueue()
    stop_on_signals(inbox)
    while True:
        config = zenoh_config.router(listen, link) if config_file is None else whole(config_file)
        certificate = zenoh_config.listening_certificate(config)
        reading = zenoh_in_log() if attend is None else nullcontext()
        with giving_back(), reading, open_session(config, zenoh_log) as session, (attend or nullcontext)(session):
            log.info("listening on %s", ", ".join(config.get("listen", {}).get("endpoints", [])))
            why = _why_anew(certificate, inbox, parent)
            if why is None:
                return
        log.info("%s: listening again", why)


def _why_anew(certificate: Path | None, inbox: Inbox, parent: int | None) -> str | None:
    """Wait until a router has to listen anew, and why; None if it is to end before that.

    Zenoh reads the certificate that it shows only once. Its TLS listener takes one connection after the other, and sleeps 0.1 s
    after each that was given up meanwhile: while a router stands still all clients come, give up, and come again, faster than
    that. Whoever was connected is no longer: the lease is over.
    """
    before = certificate.stat().st_mtime_ns if certificate is not None else 0
    while parent is None or os.getppid() == parent:
        asleep = time.monotonic()
        try:
            take(inbox, PARENT_EVERY_S if certificate is None else LOOKS_EVERY_S)
        except queue.Empty:
            if certificate is None:
                continue
            if certificate.stat().st_mtime_ns != before:
                return "there is a new certificate"
            if time.monotonic() - asleep > LOOKS_EVERY_S + STOOD_STILL_S:
                return "this router stood still"
        else:
            return None
    return None
