"""What a process counts about itself, computed by hand."""

from __future__ import annotations

from typing import Any

import pytest

from examples import T0, head
from milepost.runtime.meter import Meter
from milepost_schemas import SpeedReading

S = 1_000_000_000


def reading(sequence: int, published_at_ns: int = T0, **changed: Any) -> SpeedReading:
    fields = {**head(**changed), "sequence": sequence, "published_at_ns": published_at_ns}
    return SpeedReading(**fields, speed_mps=20.0, speed_variance_m2ps2=0.04, interval_s=0.01)


def report(meter: Meter, at_s: float, **refused: int) -> dict[str, Any]:
    return meter.report(T0 + round(at_s * S), refused, 0)


def test_rates_are_counts_over_the_time_since_the_last_report() -> None:
    meter = Meter(T0)
    for sequence in range(30):
        meter.received("speed_reading", reading(sequence), T0)
    for _ in range(10):
        meter.sent("estimate")
    first = report(meter, 2.0)
    assert first["received_hz"] == {"speed_reading": 15.0}
    assert first["sent_hz"] == {"estimate": 5.0}
    meter.sent("estimate")
    second = report(meter, 2.5)
    assert second["received_hz"] == {}
    assert second["sent_hz"] == {"estimate": 2.0}


def test_expected_rates_are_those_it_was_made_with() -> None:
    assert report(Meter(T0, {"state": 50.0}), 1.0)["expected_hz"] == {"state": 50.0}
    assert report(Meter(T0), 1.0)["expected_hz"] == {}


def test_uptime_counts_from_the_beginning() -> None:
    meter = Meter(T0)
    report(meter, 1.0)
    assert report(meter, 7.5)["uptime_s"] == pytest.approx(7.5)


def test_two_reports_at_one_moment_divide_by_no_zero() -> None:
    meter = Meter(T0)
    meter.sent("estimate")
    assert report(meter, 0.0)["sent_hz"] == {"estimate": 1000.0}


@pytest.mark.parametrize(
    ("sequences", "gaps"),
    [([0, 1, 2], 0), ([5, 6], 0), ([0, 3], 2), ([0, 1, 1, 2], 0), ([0, 2, 1, 3], 1), ([3, 0, 4], 0)],
    ids=["none", "late beginning", "two lost", "repeated", "one late", "old one"],
)
def test_a_jump_in_a_sequence_is_a_gap(sequences: list[int], gaps: int) -> None:
    meter = Meter(T0)
    for sequence in sequences:
        meter.received("speed_reading", reading(sequence), T0)
    assert report(meter, 1.0)["gaps"] == gaps


def test_sequences_of_other_units_streams_and_instances_are_their_own() -> None:
    meter = Meter(T0)
    meter.received("speed_reading", reading(0), T0)
    meter.received("speed_reading", reading(9, unit="loop"), T0)
    meter.received("speed_reading", reading(7, instance="successor"), T0)
    meter.received("other", reading(5), T0)
    assert report(meter, 1.0)["gaps"] == 0


def test_gaps_are_counted_over_the_whole_life() -> None:
    meter = Meter(T0)
    for sequence in (0, 3):
        meter.received("speed_reading", reading(sequence), T0)
    assert (report(meter, 1.0)["gaps"], report(meter, 2.0)["gaps"]) == (2, 2)


def test_steps_and_latencies_are_median_99th_percentile_and_maximum() -> None:
    meter = Meter(T0)
    for number in range(101):
        meter.stepped((100 - number) * 1e-6)
        meter.received("speed_reading", reading(number, T0 - number * 1_000_000), T0)
    body = report(meter, 1.0)
    for name in ("step_us", "latency_ms"):
        spread = body[name]
        assert (spread.p50, spread.p99, spread.max) == pytest.approx((50.0, 99.0, 100.0))


def test_where_nothing_happened_there_is_no_spread() -> None:
    meter = Meter(T0)
    meter.stepped(1e-6)
    assert report(meter, 1.0)["step_us"].max == pytest.approx(1.0)
    quiet = report(meter, 2.0)
    assert (quiet["step_us"], quiet["latency_ms"]) == (None, None)


def test_refusals_and_rewinds_are_passed_on() -> None:
    body = Meter(T0).report(T0 + S, {"duplicate": 2}, 3)
    assert (body["refused"], body["rewinds"]) == ({"duplicate": 2}, 3)
