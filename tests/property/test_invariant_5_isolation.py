"""Invariant 5: with a sensor's observations withdrawn, the result is bit for bit that of the same estimates without them."""

from __future__ import annotations

import random

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from invented import HORIZON_NS, NS_PER_S, PRIOR, T0, Biased, Plain, Q, doubts_of, drive, layout_of, lying, sensors

from milepost.fusion.information_rule import InformationFusion
from milepost.fusion.rule import NO_DOUBTS, NO_JUDGES
from milepost.nodes.observations import of_fix, of_reading


def observations_of(units, readings, fixes):
    order = list(units)
    out = [o for r in readings for o in of_reading(r, order.index(r.unit), units[r.unit].observe(r, None))]
    return out + [of_fix(f, len(units)) for f in fixes]


def fusion_with(units, observations, now, doubts=NO_DOUBTS):
    fusion = InformationFusion(layout_of(units), Q, PRIOR, HORIZON_NS, True, NO_JUDGES, doubts)
    for o in observations:
        assert fusion.estimator.insert(o, now) is None
    return fusion


def states(fusion, length_s):
    out = []
    for k in range(int(length_s * 50)):
        state = fusion.state_at(T0 + k * 20_000_000, {})
        out.append(None if state is None else (state[0], state[1]))
    return out


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), unit=st.sampled_from(["plain", "biased", "reader"]), onset=st.floats(0.0, 4.0))
def test_withdrawn_observations_leave_no_trace(seed, unit, onset):
    rng = random.Random(seed)
    units = sensors(Plain, Biased)
    readings, fixes = drive(seed, units, 4.0, 30.0)
    everything = observations_of(units, readings, fixes)
    rng.shuffle(everything)
    since, now = T0 + round(onset * NS_PER_S), T0 + 4 * NS_PER_S
    fusion = fusion_with(units, everything, now)
    states(fusion, 4.0)  # everything has been replayed once before the fault is recognised
    out = fusion.estimator.withdraw(unit, since)
    kept = [o for o in everything if not (o.unit == unit and o.measured_at_ns >= since)]
    assert len(out) == len(everything) - len(kept)
    assert states(fusion, 4.0) == states(fusion_with(units, kept, now), 4.0)


def said_of_units(fusion, length_s):
    """What the bank publishes beside the belief: intervals, doubts, resets, and why which unit is excluded."""
    out = []
    for k in range(int(length_s * 50)):
        fused = fusion.state_at(T0 + k * 20_000_000, {})
        if fused is not None:
            excluded = {unit: verdict.excluded for unit, verdict in fused.verdicts.items() if verdict.excluded is not None}
            out.append((fused.bounds, fused.doubted, fused.reset, excluded))
    return out


@settings(deadline=None, max_examples=12)
@given(seed=st.integers(0, 2**32 - 1), unit=st.sampled_from(["plain", "biased", "reader"]), onset=st.floats(0.0, 4.0))
def test_withdrawn_observations_leave_no_trace_in_the_bank(seed, unit, onset):
    """Every decision is as if the withdrawn unit had not spoken since, also that on another, which lies."""
    units = sensors(Plain, Biased)
    readings, fixes = drive(seed, units, 4.0, 30.0)
    everything = observations_of(units, lying(readings, "plain", 1.0, 1.8, 3.0), fixes)
    random.Random(seed).shuffle(everything)
    doubts, since, now = doubts_of(units, 30.0), T0 + round(onset * NS_PER_S), T0 + 4 * NS_PER_S
    fusion = fusion_with(units, everything, now, doubts)
    decided = said_of_units(fusion, 4.0)
    assert any(excluded for *_, excluded in decided)
    out = fusion.estimator.withdraw(unit, since)
    kept = [o for o in everything if not (o.unit == unit and o.measured_at_ns >= since)]
    without = fusion_with(units, kept, now, doubts)
    assert states(fusion, 4.0) == states(without, 4.0)
    assert said_of_units(fusion, 4.0) == said_of_units(without, 4.0)
    fusion.estimator.restore(out)
    assert said_of_units(fusion, 4.0) == decided


def test_withdrawn_observations_can_be_put_back_exactly():
    units = sensors(Plain, Biased)
    readings, fixes = drive(11, units, 3.0, 30.0)
    everything, now = observations_of(units, readings, fixes), T0 + 3 * NS_PER_S
    fusion = fusion_with(units, everything, now)
    before = states(fusion, 3.0)
    out = fusion.estimator.withdraw("biased", T0 + NS_PER_S)
    assert states(fusion, 3.0) != before
    fusion.estimator.restore(out)
    assert states(fusion, 3.0) == before
    assert np.isfinite(before[-1][0]).all()
