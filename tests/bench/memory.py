"""Whether a train that is lied to keeps its memory: `python -m tests.bench.memory`, all its nodes in this process, offline."""

from __future__ import annotations

import argparse
import gc
import json
import random
import sys
from pathlib import Path

import psutil

from milepost.chaos.cells import LIE_S, LIES
from milepost.config.train import Train, load_train
from milepost.offline.run import simulate
from milepost.simulation.faults import FaultEntry

TRAIN = Path(__file__).parents[1] / "chaos/slow-full.yaml"
EVERY_S, SAMPLE_S = 10, 60
BYTES_PER_MB = 1e6


def measure_memory(minutes: int, seed: int) -> dict[int, float]:
    """The memory of this process alone in MB, by the minute, with a random lie every 10 s of scenario time."""
    train, process = load_train(TRAIN, None, seed), psutil.Process()
    out: dict[int, float] = {}

    def sample(at_s: float) -> None:
        if at_s and at_s % SAMPLE_S == 0:
            gc.collect()
            out[int(at_s // SAMPLE_S)] = process.memory_full_info().uss / BYTES_PER_MB
            print(f"{at_s:6.0f} s  {out[int(at_s // SAMPLE_S)]:.1f} MB", file=sys.stderr, flush=True)

    simulate(train, minutes * 60.0, progress=sample, faults=_lies(train, minutes * 60, seed))
    return out


def _lies(train: Train, duration_s: int, seed: int) -> list[FaultEntry]:
    drawn = random.Random(seed)
    known = [lie for lie in LIES if lie[1] in train.sensors]
    lies = [(float(at_s), *drawn.choice(known)) for at_s in range(2 * EVERY_S, duration_s, EVERY_S)]
    return [FaultEntry.model_validate(dict(unit=u, kind=kind, from_s=t, for_s=LIE_S, **how)) for t, kind, u, how in lies]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m tests.bench.memory", description=__doc__)
    parser.add_argument("--minutes", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    print(json.dumps(measure_memory(options.minutes, options.seed)))
