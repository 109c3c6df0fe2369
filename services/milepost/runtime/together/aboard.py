"""A train's processes as nodes of one session."""

from __future__ import annotations

import queue
import uuid
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from milepost.config.roles import ROLES, processes
from milepost.config.train import Train
from milepost.nodes.base import Node
from milepost.nodes.world import WorldNode
from milepost.runtime import scenario_time
from milepost.runtime.bus import Stop, ZenohBus
from milepost.runtime.calibration_store import CalibrationStore
from milepost.runtime.clock import Clock
from milepost.runtime.together.part import (
    Part,
    begin_with_what_is_known,
    declare_alive,
    listen,
    names_of,
    stays,
    wait_for_others,
)
from milepost.sensors.base import World
from milepost_schemas import SimulationStart

from .loop import LabelledInbox, Seat


@dataclass(frozen=True)
class Boarding:
    """A train that runs in one process: its `world`, until `until_s`.

    `external`: the units whose sensors run elsewhere. `awaits`: processes besides the train's own that `world` waits for.
    """

    train: Train
    world: World | None
    until_s: float | None = None
    external: Sequence[str] = ()
    awaits: tuple[str, ...] = ()


class Member:
    """One of the train's processes: a part of it, a node, a bus."""

    def __init__(self, part: Part, session: Any, inbox: LabelledInbox) -> None:
        self.part = part
        self.node: Node = part.first_node(uuid.uuid4().hex[:8])
        self.bus = ZenohBus(session, part.train.name, inbox, shared=True)
        self.store: CalibrationStore | None = None
        self.left = False

    def appear(self) -> None:
        """Subscribe, and show a token."""
        listen(self.bus, self.node, self.part.name)
        declare_alive(self.bus, self.node, self.part.name)

    def seat(self, start: SimulationStart | None, parent: int | None, state_dir: Path | None, phase: float) -> Seat:
        """Its place in the loop, once scenario time is known. `phase`: as in `Runner`."""
        clock = Clock(start)
        self.node = self.part.node_in_time(self.node, start, clock)
        runner = self.part.runner(self.node, self.bus, clock, start, parent, phase)
        self.store = begin_with_what_is_known(runner, self.bus, self.node, clock, self.part.train, state_dir)
        return Seat(runner, self.bus.inbox, clock)

    def end(self) -> None:
        """Keep what was learned."""
        if self.store is not None:
            self.store.write()
            self.store = None

    def leave(self) -> None:
        """End, and go as a process does whose work is done."""
        if not self.left:
            self.end()
            self.bus.leave()
            self.left = True


class Aboard:
    """A train's processes in one process, listeners before speakers; `labels` are those of their inboxes, in the same order."""

    def __init__(self, boarding: Boarding, session: Any, first_label: int, ready: queue.SimpleQueue[int]) -> None:
        self._boarding = boarding
        train, own = boarding.train, []
        for process in processes(train, live=True):
            role = ROLES[process.role]
            if process.role == "sensor" and process.unit in boarding.external:
                continue
            own.append(Part(train, role, process.unit, boarding.world if role.uses_world else None, boarding.until_s))
        self.members = [Member(part, session, LabelledInbox(label, ready)) for label, part in enumerate(own, start=first_label)]
        self.start: SimulationStart | None = None
        self._over: set[str] = set()

    @property
    def _world(self) -> Member | None:
        return next((member for member in self.members if isinstance(member.node, WorldNode)), None)

    def stop(self) -> None:
        """Have whoever waits for something, and the loop, stop. A signal's handler calls it."""
        for member in self.members:
            member.bus.inbox.put(Stop())

    def appear(self) -> None:
        """Subscribe, and show all tokens."""
        for member in self.members:
            member.appear()

    def wait(self) -> bool:
        """Wait until those are there that run elsewhere; False if stopped meanwhile."""
        if (world := self._world) is None:
            return True
        self.start = scenario_time.remembered(world.bus, names_of(self._boarding.train))
        return self.start is not None or wait_for_others(world.bus, self._boarding.train, world.node, self._boarding.awaits)

    def begin(self, speed: float, announced: ExitStack) -> None:
        """Choose when scenario time begins, and tell whoever asks."""
        if (world := self._world) is None or not isinstance(world.node, WorldNode):
            return
        if self.start is None:
            self.start = scenario_time.choose_start(world.node.end_s, speed)
        announced.callback(scenario_time.announce(world.bus, self.start).undeclare)

    def over(self, member: Member) -> None:
        """One of them has nothing more to do: it goes, unless all end soon anyway."""
        self._over.add(member.part.name)
        if not stays(member.node, self.start, Clock(self.start)):
            member.leave()
        if len(self._over) == len(self.members):
            for each in self.members:
                each.leave()
