"""A soak: one train for a long time, and every few seconds a death, a stop or a lie, drawn at random."""

from __future__ import annotations

import contextlib
import random
import time
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import psutil

from milepost.checks.stalls import Stall
from milepost.config.errors import ConfigError

from .cells import BLOWS, LIE_S, LIES, targets
from .figures import Figures, Received
from .news import NotInTime
from .stack import NORMAL_S, Stack

EVERY_S = 5.0
LIES_SHARE = 0.3
# a younger process has not yet all that it works with: a fuser's banks have had all their compositions only then
GROWN_S = 300.0
BYTES_PER_MB = 1e6
GROWTH = 0.05
# a process that was forked goes on to write to pages that it shared at first
COPIED_MB = 2.0
KEPT_SHARE = 0.999
# a unit that lied again and again is on probation for up to 64 s
RECOVERS_S = 100.0

# name, process id, MB
Sample = tuple[str, int, float]


@dataclass(frozen=True)
class Blow:
    """What was done, and between when and when epochs may be missing for it."""

    begin_ns: int
    until_ns: int
    what: str


@dataclass
class Soak:
    """What came of a soak. `memory_mb`: of each name's process that grew most, when it was five minutes old and at its
    end; none of one that lived shorter.

    `missing_elsewhere`: epochs without a state that neither a blow nor a stall of the machine excuses. `repeated_after`: states
    that came twice or out of order, by the blow before.
    """

    minutes: float
    seed: int
    figures: Figures
    blows: list[Blow] = field(default_factory=list)
    missing_elsewhere: int = 0
    repeated_after: dict[str, int] = field(default_factory=dict)
    memory_mb: dict[str, tuple[float, float]] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        """Whether everything was kept."""
        return not self.failures

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"passed": self.passed, **asdict(self)}


def soak(train_file: Path, minutes: float, seed: int, told: Callable[[str], None]) -> Soak:
    """Break a train in a random way every 5 s for so many minutes; `told` is given a sentence for each blow."""
    out, drawn = Soak(minutes, seed, Figures()), random.Random(seed)
    with Stack(train_file) as stack:
        samples: list[Sample] = []
        try:
            stack.recovered(NORMAL_S)
            begun = time.monotonic()
            with stack.measured() as out.figures:
                for number in range(1, max(1, round(60.0 * minutes / EVERY_S)) + 1):
                    out.blows.append(_strike(stack, drawn, out.failures))
                    told(f"{time.monotonic() - begun:6.0f} s  {out.blows[-1].what}")
                    time.sleep(max(0.0, begun + number * EVERY_S - time.monotonic()))
                    samples += _samples(stack)
                stack.recover(out.figures, RECOVERS_S)
        except (NotInTime, LookupError, OSError) as error:
            out.failures.append(str(error))
        out.missing_elsewhere = _missing_elsewhere(stack.witness.received, out.blows, stack.sentinel.stalls())
        out.repeated_after = _repeated_after(stack.witness.received, out.blows)
        out.memory_mb = _growths(samples)
        out.failures += [f"exception: {line.strip()}" for line in stack.tracebacks]
    out.failures += _judged(out)
    return out


def _strike(stack: Stack, drawn: random.Random, failures: list[str]) -> Blow:
    """One random lie, or one random blow to a random process."""
    # who was killed or replaced a moment ago, on a slow machine, may not be back
    lies = [lie for lie in LIES if lie[1] in stack.units and f"sensor-{lie[1]}" in stack.there]
    begin_ns = time.time_ns()
    what, allowed_s = "nothing", 0.0
    try:
        if lies and drawn.random() < LIES_SHARE:
            fault, unit, options = drawn.choice(lies)
            what = f"{unit} {fault}"
            stack.inject(unit, fault, LIE_S, **options)
        else:
            (how, blow, hangs), target = drawn.choice(BLOWS), drawn.choice(targets(stack.processes))
            what = f"{target.name} {how}"
            allowed_s = target.stopped_s if hangs else target.killed_s
            blow(stack, target.find(stack))
    except (AssertionError, ConfigError, LookupError, OSError, psutil.Error) as error:
        failures.append(f"{what}: {error}")
    return Blow(begin_ns, time.time_ns() + round(allowed_s * 1e9), what)


def _samples(stack: Stack) -> Iterator[Sample]:
    """The memory of its own of each process that is old enough."""
    for name in stack.processes:
        with contextlib.suppress(LookupError, psutil.Error):
            process = psutil.Process(stack.pid(name))
            if time.time() - process.create_time() > GROWN_S:
                yield name, process.pid, process.memory_full_info().uss / BYTES_PER_MB


def _growths(samples: Sequence[Sample]) -> dict[str, tuple[float, float]]:
    """For each name the first and the last sample of the process that grew most.

    Two processes of a name cannot be compared: one that was forked shares what one that was started anew has for itself.
    """
    of: dict[tuple[str, int], list[float]] = {}
    for name, pid, mb in samples:
        of.setdefault((name, pid), []).append(mb)
    out: dict[str, tuple[float, float]] = {}
    for (name, _), mbs in of.items():
        if name not in out or mbs[-1] * out[name][0] > mbs[0] * out[name][1]:
            out[name] = mbs[0], mbs[-1]
    return out


def _missing_elsewhere(received: Sequence[Received], blows: Sequence[Blow], stalls: Sequence[Stall]) -> int:
    """The epochs without a state that neither a blow nor a stall of the machine excuses."""
    epochs = {state.epoch for _, state in received}
    if not epochs:
        return 0
    newest = received[-1][1]
    period_ns = newest.measured_at_ns // newest.epoch
    excuses = [(blow.begin_ns, blow.until_ns) for blow in blows] + [(a - period_ns, b + period_ns) for a, b in stalls]
    missing = [epoch * period_ns for epoch in range(min(epochs), max(epochs)) if epoch not in epochs]
    return sum(not any(begin <= at <= until for begin, until in excuses) for at in missing)


def _repeated_after(received: Sequence[Received], blows: Sequence[Blow]) -> dict[str, int]:
    """How many states of an epoch that was there already, or of an earlier one, came after each blow."""
    out: dict[str, int] = {}
    newest, begun = -1, [blow.begin_ns for blow in blows]
    for at_ns, state in received:
        if state.epoch > newest:
            newest = state.epoch
            continue
        number = bisect_right(begun, at_ns)
        what = f"{blows[number - 1].what}, {(at_ns - begun[0]) * 1e-9 // 10 * 10:.0f} s" if number else "the beginning"
        out[what] = out.get(what, 0) + 1
    return out


def _judged(out: Soak) -> Iterator[str]:
    """Sentences about what was not kept."""
    figures = out.figures
    if not figures.compared:
        yield "no state could be compared with the truth"
    if figures.violations:
        yield f"{figures.violations} states whose interval did not hold the truth"
    if out.missing_elsewhere > (1.0 - KEPT_SHARE) * (figures.states + figures.missing):
        yield f"{out.missing_elsewhere} epochs missing outside the allowed gaps"
    for name, (first, last) in out.memory_mb.items():
        if last > (1.0 + GROWTH) * first + COPIED_MB:
            yield f"{name}: grew from {first:.1f} to {last:.1f} MB"
