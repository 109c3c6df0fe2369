"""What comes from outside, or after a restart, must neither end a node nor make it say something false."""

from __future__ import annotations

import math

import numpy as np
import pytest
from invented import NS_PER_S, T0, Plain, drive, filter_of, fix, fuser_of, reading, sensors
from pydantic import ValidationError

from milepost.fusion.rule import Fused
from milepost.track.track import Track
from milepost_schemas import Estimate, Feedback, Gaussian, SpeedReading


def run(units, readings, fuser, filters):
    outputs = []
    for r in readings:
        for estimate in filters[r.unit].step(r, r.measured_at_ns):
            outputs += fuser.step(estimate.message, r.measured_at_ns) if estimate.stream == "estimate" else []
    return outputs


def states(outputs):
    return [o.message for o in outputs if o.stream == "state"]


def test_a_fuser_restarted_after_an_hour_has_wide_intervals():
    """GIVEN feedback an hour old, WHEN a fuser continues from it, THEN its interval holds wherever the train got to."""
    units = sensors(Plain)
    names = ["position_m", "speed_mps", "acceleration_mps2"]
    head = {"train": "t", "unit": "fuser", "instance": "old", "sequence": 0, "measured_at_ns": T0, "published_at_ns": T0}
    fused = Gaussian(states=names, mean=[5000.0, 20.0, 0.0], covariance=np.eye(3).tolist())
    feedback = Feedback(**head, fused=fused, shares={"plain": 1.0})
    fuser, later = fuser_of(units), T0 + 3600 * NS_PER_S
    assert fuser.catch_up(feedback, later)
    outputs = []
    for i in range(50):
        at = later + i * 20_000_000
        for estimate in filter_of(units, "plain").step(reading("plain", i, 3600 + 0.02 * i, 20.0, 0.04), at):
            outputs += fuser.step(estimate.message, at)
    last = states(outputs)[-1]
    assert last.position_min_m < 5000.0 + 20.0 * 3600.0 < last.position_max_m


def test_the_first_states_after_a_restart_list_awaited_units():
    """GIVEN a periodic unit, WHEN a fuser continues before any estimate has reached it, THEN its states say so."""
    units = sensors(Plain)
    readings, _ = drive(1, units, 1.0, 50.0)
    outputs = run(units, readings, fuser_of(units), {"plain": filter_of(units, "plain")})
    feedback = [o.message for o in outputs if o.stream == "feedback"][-1]
    fuser = fuser_of(units, period_ns=20_000_000)
    assert fuser.catch_up(feedback, feedback.measured_at_ns)
    assert states(fuser.tick(feedback.measured_at_ns + 20_000_000)) == []
    first = states(fuser.tick(feedback.measured_at_ns + 36_000_000))
    assert [s.awaiting for s in first] == [["plain"]]


def test_feedback_from_the_future_is_not_continued_from():
    units = sensors(Plain)
    readings, _ = drive(1, units, 1.0, 50.0)
    fuser = fuser_of(units)
    outputs = run(units, readings, fuser, {"plain": filter_of(units, "plain")})
    feedback = [o.message for o in outputs if o.stream == "feedback"][-1]
    assert not fuser_of(units).catch_up(feedback, feedback.measured_at_ns - 2 * NS_PER_S)


@pytest.mark.parametrize("ahead_s", [-10.0, 3600.0])
def test_an_untimely_reading_without_observations_is_refused_like_any_other(ahead_s):
    class Silent(Plain):
        kind = "plain"

        def observe(self, reading, belief):
            return ()

    units = sensors(Silent)
    local = filter_of(units, "plain")
    list(local.step(reading("plain", 0, 0.0, 20.0, 0.04), T0))
    outputs = list(local.step(reading("plain", 1, ahead_s, 20.0, 0.04), T0))
    assert [o.message.code for o in outputs] == ["refused_too_old" if ahead_s < 0 else "refused_from_future"]


def test_feedback_with_a_vanishing_share_is_ignored():
    units = sensors(Plain)
    readings, _ = drive(1, units, 1.0, 50.0)
    local = filter_of(units, "plain")
    outputs = run(units, readings, fuser_of(units), {"plain": local})
    feedback = next(o.message for o in outputs if o.stream == "feedback")
    tiny = feedback.model_copy(update={"shares": {"plain": 1e-320}})
    list(local.step(tiny, readings[-1].measured_at_ns))
    assert list(local.step(reading("plain", 999, 1.2, 20.0, 0.04), T0 + round(1.2 * NS_PER_S)))


@pytest.mark.parametrize(
    "fields",
    [
        {"speed_mps": 20.0, "speed_variance_m2ps2": 1e-13},
        {"speed_max_mps": 0.0},
        {"speed_max_mps": -50.0},
    ],
)
def test_readings_out_of_range_are_refused_by_the_schema(fields):
    head = {"train": "t", "unit": "u", "instance": "i", "sequence": 0, "measured_at_ns": T0, "published_at_ns": T0}
    with pytest.raises(ValidationError):
        SpeedReading(**head, **fields)


def test_a_fix_a_quarter_of_the_earth_away_is_infinitely_far_from_the_track():
    assert Track([(4.5, 50.9), (4.6, 50.9)]).project(0.0, 94.55).cross_track_m == math.inf


@pytest.mark.parametrize("rule", ["information", "federated"])
def test_beliefs_from_another_time_or_without_variance_are_refused_and_counted(rule):
    units = sensors(Plain)
    readings, _ = drive(1, units, 1.0, 50.0)
    fuser, local = fuser_of(units, rule), filter_of(units, "plain")
    estimates = [o.message for r in readings for o in local.step(r, r.measured_at_ns)]
    for e in estimates:
        list(fuser.step(e, e.measured_at_ns))
    now, last = estimates[-1].measured_at_ns, estimates[-1]
    observation = last.observations[0].model_copy(update={"measured_at_ns": now + 3600 * NS_PER_S, "reading_sequence": 9999})
    ahead = last.model_copy(update={"measured_at_ns": now + 3600 * NS_PER_S, "observations": [observation]})
    assert [o.message.code for o in fuser.step(ahead, now) if o.stream == "event"] == ["refused_from_future"]
    nothing = last.belief.model_copy(update={"covariance": [[0.0] * 3] * 3})
    list(fuser.step(last.model_copy(update={"belief": nothing, "observations": []}), now))
    assert states(fuser.tick(now + 40_000_000))[-1].status in ("normal", "initialising")


def test_the_federated_rule_settles_every_epoch_and_twice_the_same():
    units = sensors(Plain)
    readings, fixes = drive(4, units, 12.0, 50.0)
    fuser, local = fuser_of(units, "federated"), filter_of(units, "plain")
    live, settled = {}, []
    for message in sorted([*readings, *fixes], key=lambda m: m.measured_at_ns):
        now = message.measured_at_ns
        settled += fuser.settled_states(now)
        outputs = list(fuser.tick(now))
        if message.unit == "plain":
            for estimate in local.step(message, now):
                outputs += fuser.step(estimate.message, now)
        else:
            outputs += fuser.step(message, now)
        for o in outputs:
            if o.stream == "state":
                live[o.message.epoch] = o.message.position_m
            elif o.stream == "feedback":
                list(local.step(o.message, now))
    settled += fuser.settled_states(None)
    assert len(settled) > 550
    shared = [s for s in settled if s.epoch in live]
    assert max(abs(s.position_m - live[s.epoch]) for s in shared) < 0.05


def test_a_balise_service_that_is_gone_shows_in_the_state():
    units = sensors(Plain)
    readings, _ = drive(1, units, 2.0, 50.0)
    fuser, local = fuser_of(units), {"plain": filter_of(units, "plain")}
    before = states(run(units, readings[:80], fuser, local))[-1]
    fuser.unit_alive("balise", False)
    after = states(run(units, readings[80:], fuser, local))[-1]
    assert before.excluded == []
    assert [(e.unit, e.reason) for e in after.excluded] == [("reader", "process gone")]


def test_a_reading_that_cannot_be_used_is_not_awaited():
    """A receiver that coasts speaks: its unit is neither due nor silent, it has nothing to say."""
    units = sensors(Plain)
    readings, _ = drive(1, units, 3.0, 50.0)
    fuser, local = fuser_of(units), filter_of(units, "plain")
    run(units, readings[:100], fuser, {"plain": local})
    estimate = next(o.message for o in local.step(readings[100], readings[100].measured_at_ns))
    at = readings[100].measured_at_ns + 2 * NS_PER_S
    for i in range(100):
        empty = Estimate.model_validate(
            estimate.model_dump() | {"observations": [], "measured_at_ns": at + i * 20_000_000, "sequence": 1000 + i}
        )
        outputs = list(fuser.step(empty, at + i * 20_000_000))
    assert [(e.unit, e.reason) for e in states(outputs)[-1].excluded] == [("plain", "no usable reading")]


def test_the_interval_holds_the_worst_location_accuracy_until_a_balise_is_known():
    from milepost.nodes.roster import Presence
    from milepost.nodes.telling.state_writer import StateWriter
    from milepost.track.line import Balise, Line

    line = Line("l", 1e4, (Balise("a", 100.0, 0.1), Balise("b", 200.0, 12.0)), 0.5)
    writer = StateWriter(line, 20_000_000, 5.0, 100.0)
    head = {"train": "t", "unit": "fuser", "instance": "i", "sequence": 0, "measured_at_ns": T0, "published_at_ns": T0}
    fused = Fused([50.0, 20.0, 0.0], (np.eye(3) * 0.01).tolist(), {}, T0 - NS_PER_S)
    presence = Presence({"plain": 0.0}, {"plain": 1.0}, {})
    before = writer.write(head, fused, presence, T0 - NS_PER_S, [], settled=False)
    assert before.position_max_m - before.position_m == pytest.approx(0.5 + 0.5 + 12.0)
    writer.passed(fix(0, 0.0, 100.0).model_copy(update={"location_accuracy_m": 0.1}))
    after = writer.write(head, fused, presence, T0 - NS_PER_S, [], settled=False)
    assert after.position_max_m - after.position_m == pytest.approx(0.5 + 0.5 + 0.1)
