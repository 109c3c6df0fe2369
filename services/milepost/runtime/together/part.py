"""What a process of a train does before its loop begins, alone in a process of the operating system or with the others."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from milepost.config.rates import expected_hz
from milepost.config.roles import ROLES, Role, Setting, process_name, processes
from milepost.config.train import Train
from milepost.estimation.time_units import NS_PER_S
from milepost.nodes.base import Node, Output, Severity
from milepost.runtime import scenario_time
from milepost.runtime.bus import ZenohBus
from milepost.runtime.calibration_store import CalibrationStore, calibration_store_for
from milepost.runtime.catching_up.asking import catch_up, serve
from milepost.runtime.clock import Clock
from milepost.runtime.instances import Change, lasting_others
from milepost.runtime.logs.records import log_event
from milepost.runtime.runner import Runner, second_instance
from milepost.sensors.base import World
from milepost_schemas import SimulationStart

# a process that comes later than this into a running simulation was started again
LATE_S = 3.0
# a listener that comes later than this may have missed the first readings; one that was only slow has them in its inbox
AGAIN_S = 0.5
# listeners outlive the end of a simulation by this, to hear its last messages
GRACE_NS = NS_PER_S // 5
# who has nothing more to say so shortly before the end stays until the listeners are gone: they would tell that it is absent
LAST_NS = 2 * NS_PER_S


def names_of(train: Train) -> set[str]:
    """The names of all processes of a train."""
    return {process.name for process in processes(train, live=True)}


@dataclass(frozen=True)
class Part:
    """What one process has in a train: a role, for a unit. `world`: the train's, where the role needs it, until `until_s`."""

    train: Train
    role: Role
    unit: str
    world: World | None = None
    until_s: float | None = None

    @property
    def name(self) -> str:
        """The name of the process."""
        return process_name(self.role.name, self.unit)

    def first_node(self, instance: str) -> Node:
        """The node before scenario time is known. Raises ConfigError."""
        # where nobody owns scenario time it is UTC, and begins now
        from_s = 0.0 if self.train.has_scenario_time else Clock().now_ns() / NS_PER_S
        setting = Setting(instance, self.world, from_s=from_s, until_s=self.until_s, live=True)
        return self.role.build(self.train, self.unit, setting)

    def node_in_time(self, first: Node, start: SimulationStart | None, clock: Clock) -> Node:
        """The node that takes the first one's place once scenario time is known, if its role depends on it."""
        if start is None:
            return first
        late_s = (clock.now_ns() - start.start_ns) / NS_PER_S
        if not self.role.uses_world:
            if late_s > AGAIN_S:
                first.began(start.start_ns)
            return first
        # a process that is a little late still begins at the beginning: the prior belongs to the first reading
        from_s = late_s if late_s > LATE_S else 0.0
        setting = Setting(first.instance, self.world, start.start_ns, from_s, self.until_s)
        node = self.role.build(self.train, self.unit, setting)
        node.continue_numbering(first)
        return node

    def runner(
        self, node: Node, bus: ZenohBus, clock: Clock, start: SimulationStart | None, parent: int | None, phase: float = 0.0
    ) -> Runner:
        """The loop of the node, which ends a moment after scenario time. `phase`: as in `Runner`."""
        end_ns = start.end_ns + GRACE_NS if start is not None else None
        rates, health_every_s = expected_hz(self.train, self.role, self.unit, node), self.train.file.health_every_s
        return Runner(self.name, node, bus, clock, end_ns, parent, rates, health_every_s, phase)


def begin_with_what_is_known(
    runner: Runner, bus: ZenohBus, node: Node, clock: Clock, train: Train, state_dir: Path | None
) -> CalibrationStore | None:
    """Begin with what the others know, or with what was kept on disk; where it is kept from now on."""
    # without feedback nobody could tell a restarted filter that the fused state holds already what it kept
    store = calibration_store_for(node, train.name, state_dir if train.file.fusion.feedback else None)
    if not (node.remembers and catch_up(bus, node, clock, names_of(train))) and store is not None:
        for output in store.restore(clock.now_ns()):
            bus.publish(*output)
    if store is not None:
        runner.every_second = store.once_a_second
    return store


def stays(node: Node, start: SimulationStart | None, clock: Clock) -> bool:
    """Whether a node that has finished keeps its token until scenario time ends."""
    return node.finished and start is not None and clock.now_ns() >= start.end_ns - LAST_NS


def wait_for_others(bus: ZenohBus, train: Train, node: Node, awaits: tuple[str, ...]) -> bool:
    """Wait until all other processes of `world`'s train are there, those it `awaits` too; False if stopped meanwhile."""

    def tell(severity: Severity, code: str, text: str) -> None:
        publish_event(bus, node.event(severity, code, text, Clock().now_ns()))

    others = {p.name for p in processes(train, live=True) if p.role != "world" and p.unit in ROLES[p.role].units(train)}
    return scenario_time.wait_for_processes(bus, others | set(awaits), tell)


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
        publish_event(bus, second_instance(node, change, Clock().now_ns()))


def publish_event(bus: ZenohBus, output: Output) -> None:
    """Send an event before there is a runner to do it, and log it."""
    bus.publish(*output)
    log_event(output.message)


def listen(bus: ZenohBus, node: Node, name: str) -> None:
    """Subscribe to what a node receives, and take the questions that it answers."""
    for subscription in node.subscriptions:
        subscribe = bus.subscribe_to_newest if subscription.newest_only else bus.subscribe
        subscribe(subscription.stream, subscription.unit)
    if node.watches_processes:
        bus.watch_tokens()
    serve(bus, node, name)
