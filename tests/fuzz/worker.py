"""One target in a process of its own: inputs, refusals by reason, crashes, slow inputs, memory."""

from __future__ import annotations

import contextlib
import gc
import hashlib
import json
import os
import sys
import time
import traceback
from dataclasses import asdict, dataclass, field
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING

from .mutations import LONGEST, mutated

if TYPE_CHECKING:
    from .targets import Target

# whose branches guide the fuzzer
GUIDING = ["milepost", "milepost_schemas", "pynmeagps", "pyubx2", "yaml"]

# a stall of the machine is no hang: an input is slow if it is so every time, by the processor's time
TIMES = 3
KEPT = 20
REASONS = 500


@dataclass
class Found:
    """What came of the inputs of one target. Inputs are kept as hexadecimal digits; one may be refused for several reasons."""

    target: str
    engine: str
    inputs: int = 0
    accepted: int = 0
    refused: int = 0
    crashed: int = 0
    seconds: float = 0.0
    reasons: dict[str, int] = field(default_factory=dict)
    crashes: dict[str, str] = field(default_factory=dict)
    slow_ms: dict[str, float] = field(default_factory=dict)
    slowest_ms: float = 0.0
    growth_mib: float = 0.0


def resident_mib() -> float:
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


def place_of(error: BaseException) -> str:
    """A crash by its kind and the last line of ours on the way to it."""
    ours = [each for each in traceback.extract_tb(error.__traceback__) if "milepost" in each.filename] or ["?"]
    last = ours[-1]
    where = last if isinstance(last, str) else f"{Path(last.filename).name}:{last.name}"
    return f"{type(error).__name__} in {where}"


class Examined:
    """A target under examination: each input is counted, timed, and its crash caught."""

    def __init__(self, target: Target, engine: str, wanted: int) -> None:
        self.target, self.wanted = target, wanted
        self.found = Found(target.name, engine)
        self._begun = time.monotonic()
        self._half_mib = 0.0

    def take(self, data: bytes) -> None:
        """Feed one input."""
        found, begun = self.found, time.thread_time()
        try:
            self._count(self.target.decode(data))
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a panic of pydantic's core is no Exception
            found.crashed += 1
            if len(found.crashes) < KEPT:
                found.crashes.setdefault(f"{place_of(error)}: {error}"[:200], data.hex())
        spent_ms = (time.thread_time() - begun) * 1e3
        found.inputs += 1
        if spent_ms > self.target.slow_ms:
            self._time_again(data)
        else:
            found.slowest_ms = max(found.slowest_ms, spent_ms)
        if found.inputs == self.wanted // 2:
            self._half_mib = self._resident()
        if found.inputs == self.wanted:
            found.growth_mib = self._resident() - self._half_mib
            found.seconds = time.monotonic() - self._begun

    def _count(self, reasons: tuple[str, ...]) -> None:
        found = self.found
        if reasons:
            found.refused += 1
        else:
            found.accepted += 1
        for reason in reasons:
            known = reason if reason in found.reasons or len(found.reasons) < REASONS else "other reasons"
            found.reasons[known] = found.reasons.get(known, 0) + 1

    def _time_again(self, data: bytes) -> None:
        fastest_ms = min(self.timed_ms(data) for _ in range(TIMES))
        self.found.slowest_ms = max(self.found.slowest_ms, fastest_ms)
        if fastest_ms > self.target.slow_ms and len(self.found.slow_ms) < KEPT:
            self.found.slow_ms[data.hex()] = fastest_ms

    def timed_ms(self, data: bytes) -> float:
        """The processor's time for one input."""
        begun = time.thread_time()
        with contextlib.suppress(Exception):  # counted before
            self.target.decode(data)
        return (time.thread_time() - begun) * 1e3

    def _resident(self) -> float:
        gc.collect()
        return resident_mib()


def seed_of(target: Target, seed: int) -> int:
    return int.from_bytes(hashlib.sha256(f"{target.name} {seed}".encode()).digest()[:4])


def by_chance(examined: Examined, seed: int) -> None:
    """Valid inputs altered by chance, and those again that were refused in a way not seen before."""
    target, random = examined.target, Random(seed_of(examined.target, seed))
    corpus = list(target.seeds)
    for data in target.seeds:
        examined.take(data)
    while examined.found.inputs < examined.wanted:
        data = mutated(random.choice(corpus), target.form, random)
        before = len(examined.found.reasons)
        examined.take(data)
        if len(examined.found.reasons) > before:
            corpus.append(data)


def guided_by_coverage(examined: Examined, seed: int, out: Path) -> None:
    """libFuzzer: inputs that reach code not reached before are altered further. It ends the process when it has done."""
    import atheris

    target = examined.target
    corpus = out.with_suffix(".corpus")
    corpus.mkdir()
    for number, data in enumerate(target.seeds):
        (corpus / str(number)).write_bytes(data)

    def take(data: bytes) -> None:
        if examined.found.inputs < examined.wanted:
            examined.take(data)
            if examined.found.inputs == examined.wanted:
                write(examined.found, out)
                os._exit(0)

    def alter(data: bytes, longest: int, seed: int) -> bytes:
        random = Random(seed)
        kind = random.random()
        if kind < 0.4:
            return atheris.Mutate(data, longest)
        if kind < 0.7:  # libFuzzer alters what is altered already, and so little would be nearly valid
            data = random.choice(target.seeds)
        return mutated(data, target.form, random)[:longest]

    options = [
        f"-seed={seed_of(target, seed) or 1}",
        f"-max_len={LONGEST}",
        "-rss_limit_mb=0",
        "-verbosity=0",
        "-close_fd_mask=3",
    ]
    atheris.Setup(["fuzz", *options, str(corpus)], take, custom_mutator=alter, internal_libfuzzer=True)
    atheris.Fuzz()


def write(found: Found, out: Path) -> None:
    out.write_text(json.dumps(asdict(found)), encoding="utf-8")


def targets(engine: str) -> dict[str, Target]:
    """The table; for libFuzzer what it imports is instrumented."""
    if engine != "atheris":
        from .targets import TARGETS

        return TARGETS
    import atheris

    with atheris.instrument_imports(include=GUIDING):
        from .targets import TARGETS
    return TARGETS


def main() -> None:
    name, engine, wanted, seed, path = sys.argv[1:]
    examined = Examined(targets(engine)[name], engine, int(wanted))
    if engine == "atheris":
        guided_by_coverage(examined, int(seed), Path(path))
    else:
        by_chance(examined, int(seed))
        write(examined.found, Path(path))


if __name__ == "__main__":
    main()
