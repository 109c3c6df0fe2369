"""A sensor's process publishes what its source measures, when it is ready, stamped when it was true."""

from __future__ import annotations

import itertools

import pytest

from examples import sensor, straight_line, surveyed_line, world
from milepost.nodes.sensor import SensorNode
from milepost.recordings.measured import Measured
from milepost.sensors import SENSORS
from milepost_schemas import BaliseTelegram, SpeedReading

S = 1_000_000_000
T0 = 1_700_000_000 * S


class Scripted:
    """A source of (ready, measured or None) pairs."""

    def __init__(self, script: list[tuple[float, Measured | None]]) -> None:
        self.script = script

    def next_s(self) -> float | None:
        return self.script[0][0] if self.script else None

    def read(self) -> Measured | None:
        return self.script.pop(0)[1]


def speed(at_s: float, value: float = 20.0) -> Measured:
    return Measured(at_s, {"speed_mps": value, "speed_variance_m2ps2": 0.04})


def node(script: list[tuple[float, Measured | None]], withhold: list[list[float]] | None = None) -> SensorNode:
    radar = sensor("doppler_radar", straight_line(), "radar", withhold_s=withhold or [])
    return SensorNode("t1", "i1", radar, Scripted(script), T0)


def test_readings_are_published_when_they_are_ready() -> None:
    process = node([(0.5, speed(0.4)), (1.0, speed(0.9))])
    assert process.next_tick_ns() == T0 + S // 2
    assert list(process.tick(T0 + S // 2 - 1)) == []
    ((stream, unit, reading),) = process.tick(T0 + S // 2)
    assert (stream, unit) == ("speed_reading", "radar")
    assert reading == SpeedReading(
        train="t1",
        unit="radar",
        instance="i1",
        sequence=0,
        measured_at_ns=T0 + 400_000_000,
        published_at_ns=T0 + S // 2,
        speed_mps=20.0,
        speed_variance_m2ps2=0.04,
    )
    assert process.next_tick_ns() == T0 + S


def test_a_late_tick_publishes_all_ready_readings_in_order() -> None:
    process = node([(0.1 * k, speed(0.1 * k, float(k))) for k in range(10)])
    told = [o.message for o in process.tick(T0 + 650_000_000)]
    assert [r.speed_mps for r in told] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert [r.sequence for r in told] == list(range(7))
    assert {r.published_at_ns for r in told} == {T0 + 650_000_000}


def test_without_a_reading_no_sequence_number_is_used() -> None:
    process = node([(0.1, speed(0.1)), (0.2, None), (0.3, speed(0.3))])
    assert [o.message.sequence for o in process.tick(T0 + S)] == [0, 1]


def test_it_is_finished_after_the_last_reading_and_not_before() -> None:
    process = node([(0.1, speed(0.1)), (0.2, speed(0.2))])
    list(process.tick(T0 + 150_000_000))
    assert not process.finished
    list(process.tick(T0 + 200_000_000))
    assert process.finished
    assert process.next_tick_ns() is None
    assert list(process.tick(T0 + S)) == []


def test_readings_measured_in_a_half_open_span_are_withheld() -> None:
    script: list[tuple[float, Measured | None]] = [(0.5 * k + 0.25, speed(0.5 * k)) for k in range(10)]
    told = [o.message.measured_at_ns for o in node(script, [[1.0, 2.0], [4.0, 9.0]]).tick(T0 + 10 * S)]
    assert [(at - T0) / S for at in told] == [0.0, 0.5, 2.0, 2.5, 3.0, 3.5]


@pytest.mark.parametrize("kind", sorted(SENSORS))
def test_simulated_sensors_keep_their_stamps_between_start_and_now(kind: str) -> None:
    on = world(end_s=12.0, jerk_psd=1e-6, line=surveyed_line())
    row = sensor(kind, on.line, "unit")
    process = SensorNode("t1", "i1", row, row.open(on, 0.0), T0)
    told = []
    for now in range(T0, T0 + 13 * S, S // 50):
        for output in process.tick(now):
            assert T0 <= output.message.measured_at_ns <= now
            assert output.stream == row.stream
            told.append(output.message)
    assert process.finished
    assert len(told) >= 2
    assert all(a.measured_at_ns < b.measured_at_ns for a, b in itertools.pairwise(told))


def test_a_balise_reader_publishes_telegrams_on_its_stream() -> None:
    on = world(end_s=6.0)
    row = sensor("balise_reader", on.line, "reader")
    process = SensorNode("t1", "i1", row, row.open(on, 0.0), T0)
    ((stream, unit, telegram),) = process.tick(T0 + 7 * S)
    assert (stream, unit, type(telegram)) == ("balise_telegram", "reader", BaliseTelegram)
    assert telegram.balise_id == "b00001"
    assert (telegram.measured_at_ns - T0) * 1e-9 == pytest.approx(5.0, abs=0.01)


class Choosy(Scripted):
    """A source that cannot use everything that it hears."""

    def __init__(self, script: list[tuple[float, Measured | None]], counts: list[dict[str, int]]) -> None:
        super().__init__(script)
        self.counts = counts
        self.skipped: dict[str, int] = {}
        self.told = {"checksum": "line 7: what it was"}

    def read(self) -> Measured | None:
        self.skipped.update(self.counts.pop(0))
        return super().read()


def test_entries_skipped_by_a_source_are_counted_and_reported_once() -> None:
    counts = [{"checksum": 2}, {"checksum": 5, "late": 1}, {}]
    source = Choosy([(0.1, None), (0.2, speed(0.2)), (0.3, speed(0.3))], counts)
    process = SensorNode("t1", "i1", sensor("doppler_radar", straight_line(), "radar"), source, T0)
    (first,) = process.tick(T0 + 100_000_000)
    assert (first.stream, first.message.code, first.message.text) == ("event", "refused_checksum", "line 7: what it was")
    assert process.refusals.counts == {"checksum": 2}
    assert [o.stream for o in process.tick(T0 + 200_000_000)] == ["speed_reading", "event"]
    assert process.refusals.counts == {"checksum": 5, "late": 1}
    assert [o.stream for o in process.tick(T0 + 300_000_000)] == ["speed_reading"]


def test_an_invalid_reading_is_refused_and_uses_no_sequence_number() -> None:
    process = node([(0.1, speed(0.1)), (0.2, speed(0.2, float("nan"))), (0.3, speed(0.3))])
    out = list(process.tick(T0 + S))
    assert [o.stream for o in out] == ["speed_reading", "event", "speed_reading"]
    assert [o.message.sequence for o in out if o.stream == "speed_reading"] == [0, 1]
    assert process.refusals.counts == {"invalid_reading": 1}
    assert "radar: speed_mps" in out[1].message.text
