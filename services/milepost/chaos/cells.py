"""THE TABLE OF CELLS: what is done to whom, and the longest time without a state that is allowed meanwhile. A row is a cell."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from milepost.runtime.launch import is_router

from .fuser_faults import flip, set_clock
from .stack import Stack
from .threats import THREATS

# between two states there are 20 ms; what an outsider of a busy machine receives has been seen up to 60 ms apart
NO_GAP_S = 0.1
STOP_S = 2.0
LIE_S = 3.0
CRASHES = 3
RECOVERY_S = 30.0

Blow = Callable[[Stack], None]
Find = Callable[[Stack], str]


@dataclass(frozen=True)
class Cell:
    """A row: after `prepare` the train must be well; `blow` breaks it; it must recover by itself within `recovery_s`.

    `hit`: who is hit; `what`: by what.
    """

    hit: str
    what: str
    blow: Blow
    gap_s: float
    recovery_s: float = RECOVERY_S
    prepare: Blow | None = None

    @property
    def name(self) -> str:
        """`fuser that leads killed`."""
        return f"{self.hit} {self.what}"


@dataclass(frozen=True)
class Target:
    """Whom a blow hits, found when it falls, and the longest gap allowed where it is killed and where it is stopped."""

    name: str
    find: Find
    killed_s: float = NO_GAP_S
    stopped_s: float = NO_GAP_S


def _killed(stack: Stack, process: str) -> None:
    stack.kill(process)


def _stopped(stack: Stack, process: str) -> None:
    stack.stop(process, STOP_S)


def _replaced(stack: Stack, process: str) -> None:
    """Ended in order, and started again by hand, as an operator replaces it."""
    stack.terminate(process)
    stack.start(process)


def _crash_loop(stack: Stack, process: str) -> None:
    """Killed again whenever it is back."""
    for _ in range(CRASHES - 1):
        stack.kill(process)
        stack.back(process, RECOVERY_S)
    stack.kill(process)


LEADER = Target("fuser that leads", lambda stack: stack.leader, 0.1, 0.3)
# the voter is a single process: it is away until it is started again
VOTER = Target("voter", lambda _: "voter", 2.0, 0.3)
ROUTER = Target("router in use", lambda stack: stack.router, 0.3, 1.0)
STANDBYS = (
    Target("fuser that stands by", lambda stack: stack.standby),
    Target("other router", lambda stack: stack.other_router),
)
BLOWS: tuple[tuple[str, Callable[[Stack, str], None], bool], ...] = (
    # what is done; does it hang rather than go
    ("killed", _killed, False),
    ("stopped 2 s", _stopped, True),
    ("replaced", _replaced, False),
)
# less time or memory: the soak does without, as these would slow the machine for all
STRAINS: tuple[tuple[str, Callable[[Stack, str], None]], ...] = (
    ("ten times slower 2 s", lambda stack, process: stack.slow(process, 10.0, STOP_S)),
    ("without memory 2 s", lambda stack, process: stack.starve(process, STOP_S)),
)
# fault, unit, options
LIES: tuple[tuple[str, str, dict[str, float]], ...] = (
    ("bias", "radar-front", {"size": 1.0}),
    ("stuck", "odometer-rear", {}),
    ("jump", "gnss", {"size": 50.0}),
    ("scale", "loop", {"factor": 1.05}),
    ("noise", "radar-rear", {"factor": 10.0}),
    ("drop_out", "imu", {}),
    ("clock_step", "odometer-front", {"by_s": -0.5}),
    ("clock_step", "gnss", {"by_s": 2.0}),
    ("clock_drift", "radar-front", {"ppm": 500.0}),
)
# which of three fusers is harmed, and what is flipped in its belief
FLIPPED = "fuser-2"
FLIPS = (("position_m", 50), ("speed_mps", 51), ("speed_mps", 63))
# by how much the clock of a fuser is off
CLOCKS_S = (2.0, 0.3, -0.3, -2.0)
# the key under attack, below `milepost/v1/{train}/`, its sender, and what that hears
STREAMS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("reading/radar-front", "sensor-radar-front", ()),
    ("reading/gnss", "sensor-gnss", ()),
    ("reading/imu", "sensor-imu", ()),
    ("estimate/odometer-rear", "filter-odometer-rear", ("reading/odometer-rear", "feedback")),
)
ATTACK_S, DELAY_S = 2.0, 0.2
CUT_OFF = (
    Target("fuser that leads", lambda stack: stack.leader, 0.3),
    Target("fuser that stands by", lambda stack: stack.standby),
    Target("sensor-radar-rear", lambda _: "sensor-radar-rear"),
    Target("filter-loop", lambda _: "filter-loop"),
)
# a filter that keeps what it has learned of its wheel
WRITER = "filter-odometer-front"
LINKED = ("fuser", "fuser-2", "sensor-radar-rear", "filter-loop")
CRASHING = ("sensor-radar-front", "filter-loop")


def targets(processes: list[str]) -> list[Target]:
    """All processes, whoever speaks first. Fusers and routers are found by what they do, three fusers that vote by name."""
    ordinary = [name for name in processes if not (name.startswith("fuser") or is_router(name))]
    standby, other_router = STANDBYS
    if VOTER.name in processes:
        fusers = [name for name in processes if name.startswith("fuser")]
        named = [*fusers, *(name for name in ordinary if name != VOTER.name)]
        return [VOTER, ROUTER, other_router, *(Target(name, _always(name)) for name in named)]
    return [LEADER, ROUTER, standby, other_router, *(Target(name, _always(name)) for name in ordinary)]


def cells(processes: list[str], units: list[str]) -> Iterator[Cell]:
    """All cells of a train with these processes and units."""
    for what, blow, hangs in BLOWS:
        for target in targets(processes):
            yield Cell(target.name, what, _at(target, blow), target.stopped_s if hangs else target.killed_s)
    for what, strain in STRAINS:
        for target in targets(processes):
            yield Cell(target.name, what, _at(target, strain), target.stopped_s)
    for target in targets(processes):
        if target is LEADER or target.name in CRASHING:
            yield Cell(target.name, "crash loop", _at(target, _crash_loop), target.killed_s)
    for fault, unit, options in LIES:
        if unit in units:
            for victim in targets(processes)[:2]:
                yield Cell(f"{unit} {fault},", f"{victim.name} killed", _lie(fault, unit, options, victim), victim.killed_s)
    if WRITER in processes:
        yield Cell(WRITER, "disk full", _disk_full, NO_GAP_S)
    yield Cell("every process,", "disk full 2 s", _no_disk, NO_GAP_S)
    if VOTER.name in processes and units:
        for state, bit in FLIPS:
            yield Cell(f"{FLIPPED},", f"bit {bit} of {state} flipped", flip(FLIPPED, state, bit), NO_GAP_S)
    if units:
        target = Target(FLIPPED, _always(FLIPPED)) if VOTER.name in processes else LEADER
        for off_s in CLOCKS_S:
            yield Cell(f"{target.name},", f"clock {off_s:+g} s off", _at(target, set_clock(off_s)), target.stopped_s)
    yield from _link_cells(processes)
    for key, sender, heard in STREAMS:
        if sender in processes:
            for threat in THREATS:
                yield _attack(key, sender, heard, threat)


def _link_cells(processes: list[str]) -> Iterator[Cell]:
    def prepare(stack: Stack) -> None:
        for name in LINKED:
            if name in stack.processes:
                stack.link(name)
                # one fuser after the other
                stack.recovered(RECOVERY_S)

    for target in CUT_OFF:
        if target.name.startswith("fuser") or target.name in processes:
            yield Cell(target.name, "cut off 2 s", _at(target, _cut), target.killed_s, prepare=prepare)
            yield Cell(target.name, "delayed 0.2 s", _at(target, _delayed), target.killed_s, prepare=prepare)


def _disk_full(stack: Stack) -> None:
    """Nothing can be written until the filter has said so."""
    heard = len(stack.train.errors)
    with stack.disk_full(WRITER):
        stack.wait_for(lambda: any("is not kept" in each for each in stack.train.errors[heard:]), 10.0, f"{WRITER} complains")


def _no_disk(stack: Stack) -> None:
    """No process can write anything, to /tmp or elsewhere."""
    with stack.disk_full(*stack.processes):
        time.sleep(STOP_S)


def _cut(stack: Stack, process: str) -> None:
    stack.cut(process, STOP_S)


def _delayed(stack: Stack, process: str) -> None:
    stack.delay(process, DELAY_S, STOP_S)


def _attack(key: str, sender: str, heard: tuple[str, ...], threat: str) -> Cell:
    def prepare(stack: Stack) -> None:
        stack.behind(sender, [f"milepost/v1/{stack.name}/{each}" for each in heard])

    def blow(stack: Stack) -> None:
        relay = stack.behind(sender, ())
        relay.attack(f"milepost/v1/{stack.name}/{key}", THREATS[threat]())
        try:
            time.sleep(ATTACK_S)
        finally:
            relay.relent()

    return Cell(key, threat, blow, NO_GAP_S, prepare=prepare)


def _always(name: str) -> Find:
    return lambda _: name


def _at(target: Target, blow: Callable[[Stack, str], None]) -> Blow:
    return lambda stack: blow(stack, target.find(stack))


def _lie(fault: str, unit: str, options: dict[str, float], victim: Target) -> Blow:
    def blow(stack: Stack) -> None:
        stack.inject(unit, fault, LIE_S, **options)
        stack.kill(victim.find(stack))

    return blow
