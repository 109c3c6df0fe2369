"""A bank that drops other explanations of an exclusion keeps everything else as it was."""

from __future__ import annotations

import numpy as np

from banks import Ride, receiver, speedometer
from milepost.fusion.bank_state import narrowed, recomposed
from milepost.fusion.hypotheses import NOBODY, Rows, sources

TRAIN = Ride((speedometer("a"), speedometer("b", phase_s=0.025), speedometer("c", phase_s=0.01), receiver()))
THREE = frozenset("abc")


def test_the_rows_that_stay_keep_their_beliefs_tests_and_verdicts() -> None:
    """Three causes at once are no row of a bank without exclusions: as another explanation they were one."""
    bank = list(TRAIN.moments(5.0))[-1].bank
    wide = Rows(bank.rows.doubts, NOBODY, frozenset((THREE,)), frozenset(("receiver",)))
    extended = recomposed(bank, wide, sources(wide, bank.rows, bank.alive, lambda s: (s,), 0))
    refuted = wide.places[frozenset(("b",))]
    alive = np.arange(len(wide.sets)) != refuted
    dead_ns = tuple(7 if i == refuted else 0 for i in range(len(wide.sets)))
    extended = extended._replace(alive=alive, dead_ns=dead_ns, leader=wide.places[frozenset(("c",))])

    after = narrowed(extended, bank.rows)

    assert after.rows is bank.rows
    assert THREE not in after.rows.places
    assert np.array_equal(after.x, bank.x)
    assert np.array_equal(after.P, bank.P)
    for kept, before in zip(after.channels, bank.channels, strict=True):
        assert np.array_equal(kept.sums, before.sums)
        assert len(kept.strikes) == len(after.x)
    assert [after.rows.sets[i] for i in np.flatnonzero(~after.alive)] == [frozenset(("b",))]
    assert [after.rows.sets[i] for i, ns in enumerate(after.dead_ns) if ns] == [frozenset(("b",))]
    assert after.rows.sets[after.leader] == frozenset(("c",))
