"""The fuser's step with its bank of hypotheses, beside the same step with one belief and beside its bare arithmetic."""

from __future__ import annotations

import timeit
from dataclasses import replace
from pathlib import Path

import numpy as np

from milepost.config.roles import fuser_settings
from milepost.config.train import load_train
from milepost.estimation.beliefs import joined
from milepost.estimation.estimator import Estimator
from milepost.estimation.layout import Layout
from milepost.estimation.stack import Linear, Motion, Stack
from milepost.fusion.evidence import WINDOWS, Bounds, extended
from milepost.fusion.hypotheses import NOBODY, Doubts, Rows
from milepost.fusion.information_rule import InformationFusion
from milepost.fusion.rule import Fused
from milepost.fusion.rules import RULES
from milepost.nodes.fuser import FuserNode
from milepost.offline.collector import rare_collection
from milepost.offline.run import simulate

DURATION_S = 10.0
ROUNDS = 5


class OneBelief(InformationFusion):
    """The rule `information` with one belief, in the fastest kernel that holds it, from the filters' rows."""

    def __init__(self, layout, jerk_psd, prior, horizon_ns, *_):
        self.estimator = Estimator(layout, jerk_psd, prior, horizon_ns)
        self.names, self.counters = layout.names, self.estimator.counters

    def state_at(self, at_ns, shares, live=False):
        found = self.estimator.lists_at(at_ns)
        return found and Fused(*found, {}, self.estimator.timeline.earliest_ns)


RULES["one belief"] = OneBelief


def measure_bank(train_file: Path, duration_s: float = DURATION_S, rounds: int = ROUNDS) -> dict[str, float]:
    """µs of a fuser's step, estimate in, state and feedback out: with its bank, and with one belief; rounds alternate."""
    train = load_train(train_file)
    heard: list = []

    def listen(output, now):
        if output.stream in ("estimate", "fix"):
            heard.append((output.message, now))

    simulate(train, duration_s, listen)
    bank = fuser_settings(train)
    one = replace(bank, rule="one belief", judges={}, doubts=Doubts())
    spent: dict[str, list[float]] = {"bank": [], "one": []}
    # a process of a train collects as rarely
    with rare_collection():
        for _ in range(rounds):
            for name, settings in (("bank", bank), ("one", one)):
                node = FuserNode(train.name, "bench", settings, train.line)
                begun = timeit.default_timer()
                for message, now in heard:
                    for _ in node.step(message, now):
                        pass
                spent[name].append((timeit.default_timer() - begun) / len(heard))
    bank_us, one_us = (float(np.median(spent[name])) * 1e6 for name in ("bank", "one"))
    ratio = float(np.median([b / o for b, o in zip(spent["bank"], spent["one"], strict=True)]))
    hypotheses = len(Rows(bank.doubts, NOBODY).sets)
    bare_us = bare_arithmetic_us(bank.layout, bank.jerk_psd, hypotheses)
    found = {"hypotheses": hypotheses, "bank_us": bank_us, "one_belief_us": one_us, "bank_over_one": ratio}
    return {**found, "bare_us": bare_us}


def bare_arithmetic_us(layout: Layout, jerk_psd: float, hypotheses: int) -> float:
    """µs of numpy's calls for one prediction, one update and their tests, of a bank of this size, without any decision."""
    n, stack, bounds = layout.dimension, Stack(), Bounds(7.0)
    motion = Motion(layout, jerk_psd).over(0.02)
    B, sums = joined(np.zeros((hypotheses, n)), np.tile(np.eye(n), (hypotheses, 1, 1))), np.zeros((len(WINDOWS), hypotheses))
    row, taken = Linear(np.eye(n + 1)[1], 0.1, 0.04), np.ones(hypotheses, dtype=bool)

    def step() -> None:
        moved = stack.predict(B, motion)
        innovations = stack.innovations(moved, row)
        tested = extended(sums, innovations.nu / innovations.root)
        np.count_nonzero(bounds.exceeded(tested, 100))
        stack.update(moved, row, innovations, taken, None)

    timer = timeit.Timer(step)
    return min(timer.repeat(5, 2000)) / 2000 * 1e6
