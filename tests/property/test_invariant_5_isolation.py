"""Invariant 5: what a unit says changes no bit of a belief that leaves it out, nor of any decision while it is excluded."""

from __future__ import annotations

import random

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from invented import HORIZON_NS, NS_PER_S, PRIOR, T0, Biased, Plain, Q, doubts_of, drive, layout_of, lying, sensors

from milepost.fusion.information_rule import InformationFusion
from milepost.fusion.rule import NO_JUDGES
from milepost.nodes.observations import of_fix, of_reading

LENGTH_S, EPOCH_NS = 4.0, 20_000_000


def observations_of(units, readings, fixes):
    order = list(units)
    out = [o for r in readings for o in of_reading(r, order.index(r.unit), units[r.unit].observe(r, None))]
    return out + [of_fix(f, len(units)) for f in fixes]


def fusion_with(units, observations, seed):
    """A fuser with a bank after all observations, in an order drawn from the seed."""
    fusion = InformationFusion(layout_of(units), Q, PRIOR, HORIZON_NS, True, NO_JUDGES, doubts_of(units, 30.0))
    shuffled = list(observations)
    random.Random(seed).shuffle(shuffled)
    for o in shuffled:
        assert fusion.estimator.insert(o, T0 + round(LENGTH_S * NS_PER_S)) is None
    return fusion


def banks(fusion):
    """The bank at every epoch that has one."""
    found = (fusion.estimator.raw_at(T0 + k * EPOCH_NS) for k in range(int(LENGTH_S * NS_PER_S / EPOCH_NS)))
    return [bank for bank in found if bank is not None]


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), unit=st.sampled_from(["plain", "biased", "reader"]))
def test_rows_that_leave_a_unit_out_never_heard_what_it_said(seed, unit):
    """Other noise on the unit, too small for a decision, changes the rows that use it and no bit of the others."""
    units, chance = sensors(Plain, Biased), random.Random(seed)
    honest = observations_of(units, *drive(seed, units, LENGTH_S, 30.0))
    noisier = [o._replace(value=o.value + chance.uniform(-0.5, 0.5) * o.variance**0.5) if o.unit == unit else o for o in honest]
    changed = False
    for one, other in zip(banks(fusion_with(units, honest, seed)), banks(fusion_with(units, noisier, seed + 1)), strict=True):
        assert one.rows.sets == other.rows.sets
        for row, left_out in enumerate(one.rows.sets):
            same = np.array_equal(one.x[row], other.x[row]) and np.array_equal(one.P[row], other.P[row])
            assert same or unit not in left_out
            changed |= not same
    assert changed


@settings(deadline=None, max_examples=12)
@given(seed=st.integers(0, 2**32 - 1), size=st.floats(1.5, 5.0))
def test_another_lie_of_an_excluded_unit_changes_no_bit(seed, size):
    """Neither of the belief nor of what is decided and published beside it, until the unit is honest again."""
    units = sensors(Plain, Biased)
    readings, fixes = drive(seed, units, LENGTH_S, 30.0)
    lies = lying(readings, "plain", 1.0, 3.5, 3.0)
    others = lying(lies, "plain", 2.6, 3.5, size)
    one, other = (fusion_with(units, observations_of(units, said, fixes), seed) for said in (lies, others))
    excluded = False
    for k in range(int(3.5 * NS_PER_S / EPOCH_NS)):
        at_ns = T0 + k * EPOCH_NS
        before, after = one.state_at(at_ns, {}), other.state_at(at_ns, {})
        if before is None:
            assert after is None
            continue
        excluded |= before.verdicts["plain"].excluded is not None
        assert excluded or at_ns < T0 + 2.6 * NS_PER_S
        for name in ("mean", "covariance", "bounds", "doubted", "reset"):
            assert getattr(before, name) == getattr(after, name)
        names = [{u for u, v in fused.verdicts.items() if v.excluded is not None} for fused in (before, after)]
        assert names[0] == names[1]
    assert excluded
