"""Every kind of sensor errs as its file says, and a restarted one says what it would have said."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from examples import gnss_log, head, sensor, straight_line, surveyed_line, world
from milepost.recordings.gnss_log import read_gnss_log
from milepost.recordings.measured import Measured, Source
from milepost.sensors import SENSORS
from milepost.sensors.base import World
from milepost.track.line import Line
from milepost.track.track import Track
from milepost_schemas import BY_NAME, PositionReading

each_kind = pytest.mark.parametrize("kind", sorted(SENSORS))


def readings(source: Source, until_s: float = math.inf) -> list[Measured]:
    """All readings that are ready by a time."""
    out = []
    while (ready := source.next_s()) is not None and ready <= until_s:
        measured = source.read()
        if measured is not None:
            out.append(measured)
    return out


def opened(kind: str, on: World, from_s: float = 0.0, **options: Any) -> Source:
    return sensor(kind, on.line, **options).open(on, from_s)


def same_to_the_nanosecond(some: list[Measured], others: list[Measured]) -> bool:
    """Passages are roots, found to a picosecond from wherever the search began."""
    return [(round(m.measured_s, 9), m.fields) for m in some] == [(round(m.measured_s, 9), m.fields) for m in others]


# every kind ------------------------------------------------------------------------------------------------------------


@each_kind
def test_a_sensor_refuses_options_that_it_does_not_know(kind: str) -> None:
    with pytest.raises(ValueError, match="Extra inputs"):
        sensor(kind, straight_line(), invented=1)


@each_kind
def test_a_sensor_without_a_world_has_no_simulated_source(kind: str) -> None:
    with pytest.raises(ValueError, match="unit"):
        sensor(kind, straight_line()).open(None, 0.0)


@each_kind
def test_readings_are_valid_ordered_and_never_from_the_future(kind: str) -> None:
    source = opened(kind, world(jerk_psd=1e-6, end_s=20.0, line=surveyed_line()))
    message = BY_NAME[SENSORS[kind].stream].message
    before, count = -math.inf, 0
    while (ready := source.next_s()) is not None:
        assert ready >= before
        before = ready
        measured = source.read()
        if measured is not None:
            message(**head("unit"), **measured.fields)
            assert 0.0 <= measured.measured_s <= ready + 1e-9
            count += 1
    assert count > 0
    assert before <= 20.0 + 1.0


@each_kind
def test_readings_depend_on_seed_and_unit(kind: str) -> None:
    def said(seed: int, unit: str) -> list[Measured]:
        on = world(seed=seed, end_s=10.0, line=surveyed_line())
        return readings(sensor(kind, on.line, unit).open(on, 0.0))

    assert said(1, "a") == said(1, "a")
    assert said(1, "a") != said(2, "a")
    assert said(1, "a") != said(1, "b")


@each_kind
@pytest.mark.parametrize("from_s", [0.5, 3.0, 10.0, 10.003, 12.3456, 25.001])
def test_a_source_opened_later_gives_the_same_readings(kind: str, from_s: float) -> None:
    on = world(jerk_psd=1e-6, end_s=30.0, line=surveyed_line())
    whole, late = readings(opened(kind, on)), readings(opened(kind, on, from_s))
    missed, rest = whole[: -len(late)], whole[-len(late) :]
    assert late
    assert same_to_the_nanosecond(late, rest)
    row = sensor(kind, on.line)
    # a pulse sensor measures between two pulses that it saw itself; a mean over an interval is true in its middle
    rate_hz = getattr(row.options, "rate_hz", math.inf)
    unseen_s = 0.0 if row.period_s else 2.0 / rate_hz
    assert all(m.measured_s < from_s + unseen_s for m in missed)
    assert late[0].measured_s >= from_s - 1.0 / rate_hz


@each_kind
def test_a_source_ends_with_its_world(kind: str) -> None:
    source = opened(kind, world(end_s=3.0, line=surveyed_line()))
    said = readings(source)
    assert source.next_s() is None
    assert all(m.measured_s <= 3.0 for m in said)


# balise reader -----------------------------------------------------------------------------------------------------------


def test_every_balise_is_read_exactly_once_in_order_at_its_passage() -> None:
    on = world(end_s=200.0, jerk_psd=1e-6)
    said = readings(opened("balise_reader", on))
    passed = [b for b in on.line.balises if b.position_m <= on.motion.at(200.0)[0]]
    assert len(passed) > 30
    assert [m.fields["balise_id"] for m in said] == [b.balise_id for b in passed]
    errors = np.array([on.motion.at(m.measured_s)[0] - b.position_m for m, b in zip(said, passed, strict=True)])
    assert np.abs(errors).max() < 5.0 * 0.02
    assert {m.fields["reader_variance_m2"] for m in said} == {0.02**2}


def test_the_place_of_passage_errs_as_the_reader_states() -> None:
    line = straight_line(20_000.0, every_m=10.0)
    on = world([(0.0, 50.0)], end_s=390.0, line=line)
    said = readings(opened("balise_reader", on))
    place = {b.balise_id: b.position_m for b in line.balises}
    errors = np.array([on.motion.at(m.measured_s)[0] - place[m.fields["balise_id"]] for m in said])
    n = len(errors)
    assert n > 1900
    assert errors.std() == pytest.approx(0.02, rel=4.0 / math.sqrt(2 * n))
    assert abs(errors.mean()) < 4.0 * 0.02 / math.sqrt(n)


def test_a_telegram_is_ready_after_its_latency() -> None:
    on = world(end_s=30.0)
    source = opened("balise_reader", on, latency_s=0.25)
    seen = 0
    while (ready := source.next_s()) is not None:
        measured = source.read()
        if measured is not None:
            assert ready == pytest.approx(measured.measured_s + 0.25)
            seen += 1
    assert seen == 5


@pytest.mark.parametrize("balise", [1, 2, 3, 4, 5])
def test_a_reader_that_restarts_while_over_a_balise_neither_loses_nor_repeats_it(balise: int) -> None:
    """The heard place may lie on either side of the nominal one, and the restart between the two."""
    on = world(end_s=30.0)
    whole = readings(opened("balise_reader", on, read_std_m=0.2))
    for shift_m in np.linspace(-0.6, 0.6, 25).tolist():
        from_s = (100.0 * balise + shift_m) / 20.0
        late = readings(opened("balise_reader", on, from_s, read_std_m=0.2))
        assert same_to_the_nanosecond(late, [m for m in whole if m.measured_s >= from_s]), shift_m


def test_a_balise_is_read_after_a_stop_before_it() -> None:
    on = world([(0.0, 20.0), (10.0, 0.0), (40.0, 0.0), (50.0, 20.0)], end_s=60.0)
    said = readings(opened("balise_reader", on))
    assert [m.fields["balise_id"] for m in said] == ["b00001", "b00002", "b00003"]
    assert said[1].measured_s > 40.0


def test_a_telegram_gives_no_observation() -> None:
    reader = sensor("balise_reader", straight_line())
    assert reader.observe(object(), None) == ()
    assert reader.period_s is None
    assert reader.options.filter is None


# GNSS --------------------------------------------------------------------------------------------------------------------

POINTS = [(4.5 + 0.002 * i, 50.9) for i in range(10)]
SOLUTIONS = {
    "NARROW_INT3": "rtk_fixed",
    "WIDE_INT": "rtk_fixed",
    "NARROW_FLOAT": "rtk_float",
    "L1_FLOAT": "rtk_float",
    "PSRDIFF": "differential",
    "SINGLE": "single",
    "PROPAGATED": "propagated",
    "NONE": "none",
    "": "none",
}
COLUMNS = "time_utc,latitude_deg,longitude_deg,position_type"


def write_log(folder: Path, rows: list[str], columns: str = COLUMNS) -> Path:
    path = folder / "log.csv"
    path.write_text("\n".join([columns, *rows]) + "\n", encoding="utf-8")
    return path


def row(second: float, lon: float = 4.501, lat: float = 50.9, solution: str = "NARROW_INT3") -> str:
    return f"2022-02-25T09:32:{second:06.3f}Z,{lat},{lon},{solution}"


def gnss(path: Path, **options: Any) -> Any:
    folder = path.parent
    (folder / "line.geojson").write_text(json.dumps({"type": "LineString", "coordinates": POINTS}), encoding="utf-8")
    line = Line("l", Track(POINTS).length_m, (), 0.0, Track(POINTS))
    return sensor("gnss", line, source="recording", recording=str(path), **options)


def test_recorded_fixes_come_at_their_own_pace_counted_from_the_first(tmp_path: Path) -> None:
    path = write_log(tmp_path, [row(54.4), row(54.8), row(55.2, 4.502), row(59.9)])
    source = gnss(path).source(None, 0.0)
    ready = []
    while (t := source.next_s()) is not None:
        measured = source.read()
        assert measured.measured_s == t
        ready.append(t)
    assert ready == [0.0, 0.4, 0.8, 5.5]


def test_a_replay_opened_later_goes_on_from_there(tmp_path: Path) -> None:
    receiver = gnss(write_log(tmp_path, [row(50.0 + 0.4 * i, 4.5 + 0.001 * i) for i in range(20)]))
    whole = readings(receiver.source(None, 0.0))
    for from_s in (0.0, 0.4, 1.0, 7.6, 8.0):
        assert readings(receiver.source(None, from_s)) == [m for m in whole if m.measured_s >= from_s]


@pytest.mark.parametrize("written", SOLUTIONS)
def test_the_receivers_names_of_solutions_are_mapped(tmp_path: Path, written: str) -> None:
    path = write_log(tmp_path, [row(1.0, solution=written), row(2.0)])
    fix = readings(gnss(path).source(None, 0.0))[0]
    assert fix.fields == {"latitude_deg": 50.9, "longitude_deg": 4.501, "solution": SOLUTIONS[written]}
    PositionReading(**head("gnss"), **fix.fields)


def fix_at(chainage_m: float, aside_m: float = 0.0, solution: str = "rtk_fixed") -> PositionReading:
    lat, lon = Track(POINTS).locate(chainage_m)
    return PositionReading(**head("gnss"), latitude_deg=lat + aside_m / 111_200.0, longitude_deg=lon, solution=solution)


def test_a_fix_observes_the_chainage_with_the_variance_of_its_solution(tmp_path: Path) -> None:
    receiver = gnss(write_log(tmp_path, [row(1.0), row(2.0)]), position_std_m={"rtk_fixed": 0.1, "single": 2.0})
    for solution, variance in (("rtk_fixed", 0.01), ("single", 4.0)):
        ((h, value, r),) = receiver.observe(fix_at(321.0, 3.0, solution), None)
        assert h == (1.0, 0.0, 0.0)
        assert value == pytest.approx(321.0, abs=0.01)
        assert r == pytest.approx(variance)


@pytest.mark.parametrize("solution", ["none", "propagated", "single", "differential", "rtk_float"])
def test_a_solution_that_is_not_listed_does_not_count(tmp_path: Path, solution: str) -> None:
    receiver = gnss(write_log(tmp_path, [row(1.0), row(2.0)]))
    assert len(receiver.observe(fix_at(321.0), None)) == 1
    assert receiver.observe(fix_at(321.0, solution=solution), None) == ()


def test_a_fix_too_far_from_the_track_does_not_count_on_either_side(tmp_path: Path) -> None:
    receiver = gnss(write_log(tmp_path, [row(1.0), row(2.0)]), cross_track_limit_m=5.0)
    for aside, counts in ((4.9, True), (5.1, False), (-4.9, True), (-5.1, False), (300.0, False)):
        assert bool(receiver.observe(fix_at(500.0, aside), None)) == counts


def test_without_geometry_a_fix_does_not_count() -> None:
    assert sensor("gnss", straight_line()).observe(fix_at(100.0), None) == ()


BROKEN = {
    "latitude": ([row(1.0), row(2.0).replace("50.9", "north"), row(3.0)], "line 3: latitude_deg: "),
    "longitude": ([row(1.0), row(2.0), row(3.0).replace("4.501", "")], "line 4: longitude_deg: "),
    "time": ([row(1.0), row(2.0).replace("2022-02-25", "2022-02-31"), row(3.0)], "line 3: time_utc: "),
    "off the earth": ([row(1.0), row(2.0, lat=95.0)], "line 3: latitude_deg: "),
    "longitude twice around": ([row(1.0), row(2.0, lon=365.0)], "line 3: longitude_deg: "),
    "not a number": ([row(1.0), row(2.0).replace("50.9", "nan")], "line 3: latitude_deg: "),
    "infinite": ([row(1.0), row(2.0).replace("4.501", "inf")], "line 3: longitude_deg: "),
    "short row": ([row(1.0), "2022-02-25T09:32:02Z,50.9"], "line 3: longitude_deg: "),
    "after an empty line": ([row(1.0), "", row(2.0).replace("50.9", "x")], "line 4: latitude_deg: "),
    "one fix": ([row(1.0)], "fewer than two"),
    "no fix": ([], "fewer than two"),
    "endless field": ([row(1.0), row(2.0) + "x" * 200_000], "line 3: "),
}


@pytest.mark.parametrize("name", BROKEN)
def test_an_unreadable_entry_is_reported_by_file_line_and_field(tmp_path: Path, name: str) -> None:
    rows, says = BROKEN[name]
    path = write_log(tmp_path, rows)
    with pytest.raises(ValueError, match=r"log\.csv") as caught:
        read_gnss_log(gnss_log(path))
    assert str(caught.value).startswith(f"{path}: {says}")


@pytest.mark.parametrize("missing", COLUMNS.split(","))
def test_a_column_that_is_not_there_is_named(tmp_path: Path, missing: str) -> None:
    path = write_log(tmp_path, [row(1.0), row(2.0)], COLUMNS.replace(missing, "other"))
    with pytest.raises(ValueError, match=r"log\.csv") as caught:
        read_gnss_log(gnss_log(path))
    assert str(caught.value).startswith(f"{path}: line 1: {missing}: missing")


def test_a_log_that_is_not_text_is_named(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(b"\x89PNG\xff\xfe\x00")
    with pytest.raises(ValueError, match=r"log\.csv") as caught:
        read_gnss_log(gnss_log(path))
    assert str(caught.value).startswith(f"{path}: ")


def test_times_are_utc_whether_they_say_so_or_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "America/New_York")
    time.tzset()
    rows = [
        row(1.0),
        row(2.0).replace("Z", "+00:00"),
        row(3.0).replace("Z", ""),
        row(4.0).replace("09:32", "10:32").replace("Z", "+01:00"),
    ]
    try:
        assert [fix.t_s for fix in read_gnss_log(gnss_log(write_log(tmp_path, rows)))] == [0.0, 1.0, 2.0, 3.0]
    finally:
        monkeypatch.undo()
        time.tzset()
