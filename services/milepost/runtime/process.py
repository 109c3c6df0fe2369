"""One process from beginning to end: session, token, scenario time, node, signals."""

from __future__ import annotations

import logging
import os
import queue
import signal
import sys
import uuid
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from milepost.config.rates import expected_hz
from milepost.config.roles import ROLES, Setting, process_name, processes
from milepost.config.train import Train
from milepost.estimation.time_units import NS_PER_S
from milepost.nodes.base import Node, Output, Severity
from milepost.nodes.world import WorldNode
from milepost.offline.collector import rare_collection
from milepost.sensors.base import World
from milepost_schemas import SimulationStart

from . import scenario_time, zenoh_config
from .bus import Inbox, Stop, ZenohBus, open_session
from .calibration_store import calibration_store_for
from .catching_up.asking import catch_up, serve
from .clock import Clock
from .instances import Change, lasting_others
from .runner import Runner, second_instance
from .session_file import whole
from .zenoh_config import Connection

log = logging.getLogger("milepost")
# a process that comes later than this into a running simulation was started again
LATE_S = 3.0
# listeners outlive the end of a simulation by this, to hear its last messages
GRACE_NS = NS_PER_S // 5
# who has nothing more to say so shortly before the end stays until the listeners are gone: they would tell that it is absent
LAST_NS = 2 * NS_PER_S


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


def set_up_log(name: str) -> None:
    """Log lines to standard error, with the process's name."""
    logging.basicConfig(
        stream=sys.stderr, format=f"%(asctime)s {name}: %(message)s", datefmt="%H:%M:%S", level=logging.INFO, force=True
    )


def stop_on_signals(inbox: Inbox) -> None:
    """SIGTERM and SIGINT end the process through its inbox, so that the session closes and the token goes."""
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: inbox.put(Stop()))


def run_process(train: Train, role_name: str, unit: str, options: ProcessOptions, world: World | None = None) -> bool:
    """Run one process of a train until it is stopped or its simulation ends; whether it was stopped. Raises ConfigError.

    `world`: the train's, where the caller has built it already.
    """
    role = ROLES[role_name]
    name, instance = process_name(role_name, unit), uuid.uuid4().hex[:8]
    set_up_log(name if options.change is None else f"{train.name} {name}")
    if world is None and role.uses_world and train.file.world is not None:
        world = train.world(options.duration_s)
    # built once before anything is declared, so that a mistake in the configuration shows before anything starts
    # where nobody owns scenario time it is UTC, and begins now
    from_s = 0.0 if train.has_scenario_time else Clock().now_ns() / NS_PER_S
    node = role.build(train, unit, Setting(instance, world, from_s=from_s, until_s=options.duration_s, live=True))
    # opening waits for a router inside Zenoh, where Python cannot see a signal
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    with open_session(zenoh_config.client(options.connection)) as session:
        bus = ZenohBus(session, train.name)
        stop_on_signals(bus.inbox)
        _listen(bus, node, name)
        declare_alive(bus, node, name)
        with ExitStack() as announced:
            start: SimulationStart | None = None
            if train.has_scenario_time:
                start = _scenario_start(bus, train, node, name, options, announced)
                if start is None:
                    return True
            clock = Clock(start)
            if role.uses_world and start is not None:
                late_s = (clock.now_ns() - start.start_ns) / NS_PER_S
                # a process that is a little late still begins at the beginning: the prior belongs to the first reading
                from_s = late_s if late_s > LATE_S else 0.0
                first, node = (
                    node,
                    role.build(train, unit, Setting(instance, world, start.start_ns, from_s, options.duration_s)),
                )
                node.continue_numbering(first)
            end_ns = start.end_ns + GRACE_NS if start is not None else None
            rates = expected_hz(train, role, unit, node)
            stopped = _run(
                Runner(name, node, bus, clock, end_ns, options.parent, rates), bus, node, clock, train, options.state_dir
            )
            if not stopped and node.finished and start is not None and clock.now_ns() >= start.end_ns - LAST_NS:
                _stay(bus.inbox, clock, start.end_ns + 2 * GRACE_NS)
            return stopped


def _run(runner: Runner, bus: ZenohBus, node: Node, clock: Clock, train: Train, state_dir: Path | None) -> bool:
    """Begin with what is known, run to the end, keep what was learned; whether it was stopped."""
    # without feedback nobody could tell a restarted filter that the fused state holds already what it kept
    store = calibration_store_for(node, train.name, state_dir if train.file.fusion.feedback else None)
    if not (node.remembers and catch_up(bus, node, clock, _names(train))) and store is not None:
        for output in store.restore(clock.now_ns()):
            bus.publish(*output)
    with rare_collection():
        stopped = runner.run(store.once_a_second if store else None)
    if store is not None:
        store.write()
    return stopped


def _stay(inbox: Inbox, clock: Clock, until_ns: int) -> None:
    """Keep the token until a time, or until stopped; what comes meanwhile is left unread."""
    while (left_s := clock.wait_s(until_ns)) > 0.0:
        try:
            if isinstance(inbox.get(timeout=left_s), Stop):
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
        told = scenario_time.wait_for_start(bus, _names(train))
        if told is not None:
            announced.callback(scenario_time.remember(bus, name, told).undeclare)
        return told

    def tell(severity: Severity, code: str, text: str) -> None:
        _publish_event(bus, node.event(severity, code, text, Clock().now_ns()))

    start = scenario_time.remembered(bus, _names(train))
    if start is None:
        others = {p.name for p in processes(train, live=True) if p.role != "world" and p.unit in ROLES[p.role].units(train)}
        others |= set(options.awaits)
        if not scenario_time.wait_for_processes(bus, others, tell):
            return None
        start = scenario_time.choose_start(node.end_s, options.speed)
    announced.callback(scenario_time.announce(bus, start).undeclare)
    return start


def _names(train: Train) -> set[str]:
    """The names of all processes of a train."""
    return {process.name for process in processes(train, live=True)}


def declare_alive(bus: ZenohBus, node: Node, name: str) -> None:
    """Show this instance's token, and say if there is another one of this process: an error, but no reason to end.

    Whoever starts it may be replacing a process that hangs, and what both measure counts once. The fuser sees all tokens and
    says the same of every process, itself included.
    """
    others = lasting_others(bus.session, bus.train, name)
    bus.declare_alive(name, node.instance)
    if others and not node.watches_processes:
        instances = sorted({node.instance, *(token.instance for token in others)})
        change = Change(bus.train, name, tuple(instances))
        _publish_event(bus, second_instance(node, change, Clock().now_ns()))


def _publish_event(bus: ZenohBus, output: Output) -> None:
    """Send an event before there is a runner to do it, and log it."""
    bus.publish(*output)
    log.warning("%s", getattr(output.message, "text", ""))


def _listen(bus: ZenohBus, node: Node, name: str) -> None:
    for subscription in node.subscriptions:
        subscribe = bus.subscribe_to_newest if subscription.newest_only else bus.subscribe
        subscribe(subscription.stream, subscription.unit)
    if node.watches_processes:
        bus.watch_tokens()
    serve(bus, node, name)


def run_router(
    listen: list[str],
    config_file: Path | None,
    parent: int | None = None,
    link: Sequence[str] = (),
    zenoh_log: str = "error",
    attend: Callable[[Any], AbstractContextManager[None]] = nullcontext,
) -> None:
    """Run a Zenoh router, linked with others, until stopped, or until `parent` is no longer its parent.

    `attend` does something with its session as long as that is open.
    """
    set_up_log("router")
    inbox: Inbox = queue.SimpleQueue()
    stop_on_signals(inbox)
    while True:
        config = zenoh_config.router(listen, link) if config_file is None else whole(config_file)
        certificate = zenoh_config.listening_certificate(config)
        with open_session(config, zenoh_log) as session, attend(session):
            log.info("listening on %s", ", ".join(config.get("listen", {}).get("endpoints", [])))
            if not _until_renewed(certificate, inbox, parent):
                return
        # Zenoh reads what it shows to those that connect only once
        log.info("there is a new certificate: listening again")


def _until_renewed(certificate: Path | None, inbox: Inbox, parent: int | None) -> bool:
    """Wait until a file is another one; False if the router is to end before that."""
    before = certificate.stat().st_mtime_ns if certificate is not None else 0
    while parent is None or os.getppid() == parent:
        try:
            inbox.get(timeout=1.0)
        except queue.Empty:
            if certificate is not None and certificate.stat().st_mtime_ns != before:
                return True
        else:
            return False
    return False
