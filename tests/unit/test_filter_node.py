"""A filter's process outlives messages that are sound by themselves and yet nothing to reckon with."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest

from examples import T0, head, sensor, straight_line
from milepost.estimation.estimator import Prior
from milepost.estimation.filters import FILTERS
from milepost.estimation.filters.base import FilterSetup
from milepost.estimation.layout import Layout
from milepost.nodes.filter import FilterNode
from milepost_schemas import Estimate, Feedback, Gaussian, Message, SpeedReading

STEP = 50_000_000
PRIOR = Prior(np.array([0.0, 20.0, 0.0]), np.array([1.0, 1.0, 0.1]))


def node(kind: str, filter_kind: str, **options: Any) -> FilterNode:
    unit = sensor(kind, straight_line(), "unit", **options)
    layout = Layout((("unit", unit.private_states),)) if unit.private_states else Layout()
    row = FILTERS[filter_kind]
    local = row(FilterSetup(layout, 1e-3, PRIOR, 5 * 10**9, 0.5), row.options_model())
    return FilterNode("maglev-1", "a1b2c3d4", unit, local, 0, True)


def speed(number: int, **fields: Any) -> SpeedReading:
    at = T0 + number * STEP
    return SpeedReading(**head("unit", sequence=number, measured_at_ns=at, published_at_ns=at), **fields)


def fed_back(number: int, states: list[str], mean: float, covariance: list[list[float]]) -> Feedback:
    at = T0 + number * STEP
    fused = Gaussian(states=states, mean=[mean] * len(states), covariance=covariance)
    return Feedback(**head("fuser", measured_at_ns=at, published_at_ns=at), fused=fused, shares={"unit": 0.5})


def estimates(to: FilterNode, message: Message) -> list[Estimate]:
    return [o.message for o in to.step(message, message.measured_at_ns) if isinstance(o.message, Estimate)]


KINDS = {
    "odometer": {},
    "janus_radar": {"scale_std": 0.01},
    "doppler_radar": {"signed": False},
    "induction_loop": {"missed_probability": 0.1},
}


@pytest.mark.parametrize("filter_kind", sorted(FILTERS))
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_readings_at_the_ends_of_their_ranges_are_used_or_refused(kind: str, filter_kind: str) -> None:
    to = node(kind, filter_kind, **KINDS[kind])
    ends = product((0.0, -200.0, 200.0), (1e-12, 0.04, 1e15), (0.0, 1e-200, 0.05, 1e306))
    said = [{"speed_mps": v, "speed_variance_m2ps2": R, "interval_s": dt} for v, R, dt in ends]
    sent = [e for n, fields in enumerate(said, 1) for e in estimates(to, speed(n, **fields))]
    # what is sent is numbered without a gap
    assert [e.sequence for e in sent] == list(range(len(sent)))
    assert len(sent) + to.refusals.counts.get("unusable", 0) == len(said)


@pytest.mark.parametrize("kind", ["odometer", "doppler_radar"])
def test_impossible_feedback_is_refused_and_changes_nothing(kind: str) -> None:
    to = node(kind, "kalman")
    states = to._names
    n = len(states)
    estimates(to, speed(1, speed_mps=20.0, speed_variance_m2ps2=0.04, interval_s=0.05))
    hostile = [(0.0, np.zeros((n, n))), (0.0, np.ones((n, n))), (0.0, 1e300 * np.eye(n)), (1e308, np.eye(n))]
    # three states have an inverse that nobody needs
    counted = [h for h in hostile if n > 3 or not np.array_equal(h[1], np.ones((n, n)))]
    for number, (mean, covariance) in enumerate(counted, 2):
        assert [o.message.code for o in to.step(fed_back(number, states, mean, covariance.tolist()), T0 + number * STEP)] == (  # type: ignore[attr-defined]
            ["refused_unusable"] if number == 2 else []
        )
    assert to.refusals.counts == {"unusable": len(counted)}
    (after,) = estimates(to, speed(9, speed_mps=20.0, speed_variance_m2ps2=0.04, interval_s=0.05))
    assert after.feedback_epoch_ns is None


def test_a_filter_that_catches_up_restarts_its_observer(monkeypatch: pytest.MonkeyPatch) -> None:
    to, told = node("doppler_radar", "kalman"), []
    monkeypatch.setattr(to._observer, "restarted", lambda: told.append("restarted"))
    assert to.catch_up(fed_back(1, to._names, 0.0, np.eye(3).tolist()), T0 + STEP)
    assert told == ["restarted"]


@pytest.mark.parametrize(("moment", "why"), [(100, "too_old"), (500, "from_future")])
def test_the_fuser_is_told_of_untimely_readings_twice_a_second(moment: int, why: str) -> None:
    to, now = node("odometer", "kalman"), T0 + 320 * STEP
    for number in range(301, 311):
        estimates(to, speed(number, speed_mps=20.0, speed_variance_m2ps2=0.01, interval_s=0.05))
    untimely = [
        (n, o.message)
        for n in range(40)
        for o in to.step(speed(moment + n, speed_mps=20.0, speed_variance_m2ps2=0.01, interval_s=0.05), now + n * STEP)
        if isinstance(o.message, Estimate)
    ]
    assert [n for n, _ in untimely] == [0, 10, 20, 30]
    for _, estimate in untimely:
        assert estimate.observations == []
        assert [(r.counts, r.why) for r in estimate.readings] == [(False, why)]
