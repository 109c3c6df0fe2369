"""Invariant 3: settled states do not depend on order, delay or repetition."""

from __future__ import annotations

import random

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from invented import NS_PER_S, Biased, Plain, Scaled, doubts_of, drive, filter_of, fuser_of, lying, sensors

from milepost.fusion.rule import NO_DOUBTS

MAX_DELAY_NS = 4 * NS_PER_S


def estimates_of(units, readings):
    filters = {name: filter_of(units, name) for name in units}
    return [
        output.message for r in readings for output in filters[r.unit].step(r, r.measured_at_ns) if output.stream == "estimate"
    ]


def settle(units, messages, doubts=NO_DOUBTS):
    """(message, receipt time) in order of receipt, into a fresh fuser; ticks in between as a runner would make them."""
    fuser, states = fuser_of(units, doubts=doubts), []
    for message, now in sorted(messages, key=lambda m: m[1]):
        while (tick := fuser.next_tick_ns()) is not None and tick < now:
            states += fuser.settled_states(tick)
            list(fuser.tick(tick))
        states += fuser.settled_states(now)
        list(fuser.step(message, now))
    states += fuser.settled_states(None)
    return states, fuser


def shuffled(rng, messages, repeat=0.05):
    out = []
    for message in messages:
        for _ in range(1 + (rng.random() < repeat)):
            out.append((message, message.measured_at_ns + rng.randrange(MAX_DELAY_NS)))
    return out


@settings(deadline=None, max_examples=12)
@given(seed=st.integers(0, 2**32 - 1), private=st.booleans())
def test_estimates_and_fixes_in_any_order_settle_to_the_same_bits(seed, private):
    rng = random.Random(seed)
    units = sensors(Plain, Biased) if private else sensors(Plain)
    readings, fixes = drive(seed, units, 6.0, 25.0)
    messages = [*estimates_of(units, readings), *fixes]
    in_order, _ = settle(units, [(m, m.measured_at_ns) for m in messages])
    mixed, fuser = settle(units, shuffled(rng, messages))
    assert len(in_order) > 250
    assert fuser.rewinds > 0
    assert [s.model_dump_json() for s in mixed] == [s.model_dump_json() for s in in_order]


@settings(deadline=None, max_examples=8)
@given(seed=st.integers(0, 2**32 - 1))
def test_shuffled_readings_settle_to_the_same_state_within_a_millionth_of_a_sigma(seed):
    rng = random.Random(seed)
    units = sensors(Plain, Biased)
    readings, fixes = drive(seed, units, 6.0, 25.0)
    in_order, _ = settle(units, [(m, m.measured_at_ns) for m in [*estimates_of(units, readings), *fixes]])
    filters = {name: filter_of(units, name) for name in units}
    late = []
    for r, now in sorted(shuffled(rng, readings), key=lambda m: m[1]):
        late += [(output.message, now) for output in filters[r.unit].step(r, now) if output.stream == "estimate"]
    mixed, _ = settle(units, [*late, *shuffled(rng, fixes)])
    assert [s.epoch for s in mixed] == [s.epoch for s in in_order]
    for ours, theirs in zip(mixed, in_order, strict=True):
        sigma = np.sqrt(np.diag(theirs.covariance))
        difference = np.array([ours.position_m - theirs.position_m, ours.speed_mps - theirs.speed_mps])
        assert np.all(np.abs(difference) < 1e-6 * sigma[:2])


def with_a_liar(seed):
    """A train on which one unit lies for a second and agrees again, and one fix alone is off."""
    units = sensors(Plain, Biased, Scaled)
    readings, fixes = drive(seed, units, 6.0, 25.0)
    fixes[2] = fixes[2].model_copy(update={"position_m": fixes[2].position_m + 5.0})
    return units, lying(readings, "plain", 2.0, 3.0, 2.0), fixes, doubts_of(units, 25.0)


def excluded_over_time(states):
    """The sets of units that were excluded by the bank, one after the other."""
    out = []
    for s in states:
        units = {e.unit for e in s.excluded if e.reason not in ("does not fit", "never heard")}
        if not out or out[-1] != units:
            out.append(units)
    return out


@settings(deadline=None, max_examples=6)
@given(seed=st.integers(0, 2**32 - 1))
def test_exclusion_and_readmission_settle_to_the_same_bits_in_any_order(seed):
    rng = random.Random(seed)
    units, readings, fixes, doubts = with_a_liar(seed)
    messages = [*estimates_of(units, readings), *fixes]
    in_order, _ = settle(units, [(m, m.measured_at_ns) for m in messages], doubts)
    mixed, fuser = settle(units, shuffled(rng, messages), doubts)
    assert excluded_over_time(in_order) == [set(), {"plain"}, set()]
    assert any(e.reason == "does not fit" for s in in_order for e in s.excluded)
    assert fuser.rewinds > 0
    assert [s.model_dump_json() for s in mixed] == [s.model_dump_json() for s in in_order]


@settings(deadline=None, max_examples=6)
@given(seed=st.integers(0, 2**32 - 1))
def test_shuffled_readings_of_a_liar_settle_to_the_same_decisions(seed):
    rng = random.Random(seed)
    units = sensors(Plain, Biased)
    readings, fixes = drive(seed, units, 6.0, 25.0)
    readings, doubts = lying(readings, "plain", 2.0, 3.0, 2.0), doubts_of(units, 25.0)
    in_order, _ = settle(units, [(m, m.measured_at_ns) for m in [*estimates_of(units, readings), *fixes]], doubts)
    filters, late = {name: filter_of(units, name) for name in units}, []
    for r, now in sorted(shuffled(rng, readings), key=lambda m: m[1]):
        late += [(output.message, now) for output in filters[r.unit].step(r, now) if output.stream == "estimate"]
    mixed, _ = settle(units, [*late, *shuffled(rng, fixes)], doubts)
    assert {"plain"} in excluded_over_time(in_order)
    assert [s.excluded for s in mixed] == [s.excluded for s in in_order]
    for ours, theirs in zip(mixed, in_order, strict=True):
        sigma = np.sqrt(np.diag(theirs.covariance))
        difference = np.array([ours.position_m - theirs.position_m, ours.speed_mps - theirs.speed_mps])
        assert np.all(np.abs(difference) < 1e-6 * sigma[:2])


def test_a_repeated_reading_counts_once_whoever_repeats_it():
    """GIVEN a filter that restarts and passes a reading on a second time, THEN it is refused as a duplicate."""
    units = sensors(Plain)
    readings, _ = drive(1, units, 1.0, 25.0)
    first, second = estimates_of(units, readings), estimates_of(units, readings)
    again = [e.model_copy(update={"instance": "another"}) for e in second]
    once, _ = settle(units, [(m, m.measured_at_ns) for m in first])
    twice, fuser = settle(units, [(m, m.measured_at_ns) for m in [*first, *again]])
    assert [s.model_dump_json() for s in twice] == [s.model_dump_json() for s in once]
    assert fuser.refusals.counts["duplicate"] == len(again)


def test_untimely_observations_are_refused_and_counted():
    units = sensors(Plain)
    readings, fixes = drive(2, units, 10.0, 25.0)
    estimates = estimates_of(units, readings)
    fuser = fuser_of(units)
    for e in estimates[10:]:
        list(fuser.step(e, e.measured_at_ns))
    now = estimates[-1].measured_at_ns
    events = [*fuser.step(estimates[3], now), *fuser.step(fixes[0], now)]
    ahead = fixes[1].model_copy(update={"measured_at_ns": now + 600_000_000, "reading_sequence": 999})
    events += fuser.step(ahead, now)
    assert fuser.refusals.counts == {"too_old": 2, "from_future": 1}
    assert {o.message.code for o in events if o.stream == "event"} == {"refused_too_old", "refused_from_future"}


def test_the_prior_moves_back_when_an_earlier_observation_arrives():
    units = sensors(Plain)
    readings, _ = drive(5, units, 1.0, 25.0)
    estimates = estimates_of(units, readings)
    reverse = [(m, estimates[-1].measured_at_ns + i) for i, m in enumerate(reversed(estimates))]
    backwards, _ = settle(units, reverse)
    forwards, _ = settle(units, [(m, m.measured_at_ns) for m in estimates])
    assert [s.model_dump_json() for s in backwards] == [s.model_dump_json() for s in forwards]
