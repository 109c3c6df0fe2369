"""A user's own log becomes readings of any kind of sensor by its column map, or is refused with the place of the mistake."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from examples import head, sensor, straight_line
from milepost.recordings.column_map import CsvSource, check_map
from milepost.recordings.column_options import RecordingOptions
from milepost.recordings.measured import Measured
from milepost.recordings.units import SUFFIXES, UNITS, factor
from milepost.sensors import SENSORS
from milepost_schemas import BY_NAME, InertialReading, Message, PositionReading, SpeedReading

SPEED = {"speed_mps": {"column": "v", "unit": "km/h"}}
VARIANCE = {"speed_variance_m2ps2": 0.01}
WORDS = {"NARROW_INT*": "rtk_fixed", "SINGLE": "single", "*": "none"}
PLACE = {
    "latitude_deg": {"column": "lat", "unit": "deg"},
    "longitude_deg": {"column": "lon", "unit": "rad"},
    "solution": {"column": "fix", "values": WORDS},
}


def options(file: Path, **given: Any) -> RecordingOptions:
    entry = {"file": str(file), "time": {"column": "t"}, "columns": SPEED, "constants": VARIANCE, **given}
    return RecordingOptions.model_validate(entry)


def log(folder: Path, *rows: str, header: str = "t,v", name: str = "log.csv") -> Path:
    path = folder / name
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def replayed(given: RecordingOptions, message: type[Message] = SpeedReading, from_s: float = 0.0) -> list[Measured]:
    source = CsvSource(given, message, from_s)
    said = []
    while (ready := source.next_s()) is not None:
        measured = source.read()
        assert measured is not None
        assert from_s <= measured.measured_s <= ready
        message(**head(), **measured.fields)
        said.append(measured)
    assert source.read() is None
    return said


def test_a_column_is_read_in_its_unit_and_a_constant_stands_beside_it(tmp_path: Path) -> None:
    said = replayed(options(log(tmp_path, "10.0,36", "10.5,72.0", "11.25,-3.6")))
    assert [m.measured_s for m in said] == [0.0, 0.5, 1.25]
    assert [m.fields["speed_mps"] for m in said] == pytest.approx([10.0, 20.0, -1.0])
    assert {m.fields["speed_variance_m2ps2"] for m in said} == {0.01}


@pytest.mark.parametrize(
    ("unit", "field", "expected"),
    [
        ("km/h", "speed_mps", 1000 / 3600),
        ("mph", "speed_mps", 1609.344 / 3600),
        ("kn", "speed_mps", 1852 / 3600),
        ("deg", "latitude_deg", 1.0),
        ("rad", "latitude_deg", 180 / math.pi),
        ("1e-7 deg", "latitude_deg", 1e-7),
        ("deg/s", "turn_rate_radps", math.pi / 180),
        ("g", "specific_force_mps2", 9.80665),
        ("mm", "horizontal_std_m", 0.001),
        ("ft", "altitude_m", 0.3048),
        ("ms", "interval_s", 0.001),
        ("km2/h2", "speed_variance_m2ps2", 1 / 12.96),
        ("1", "hdop", 1.0),
    ],
)
def test_units_are_as_large_as_they_are(unit: str, field: str, expected: float) -> None:
    assert factor(unit, field) == pytest.approx(expected, rel=1e-12)


def test_every_unit_in_the_name_of_a_field_that_a_sensor_sends_is_known() -> None:
    assert all(unit in UNITS for unit in SUFFIXES.values())
    dimensionless = {"satellites", "hdop", "solution", "balise_id"}
    for kind in SENSORS.values():
        message = BY_NAME[kind.stream].message
        for name in message.model_fields.keys() - Message.model_fields.keys() - dimensionless:
            assert name.rpartition("_")[2] in SUFFIXES, name


def test_words_are_translated_whole_then_by_their_beginning_then_by_the_rest(tmp_path: Path) -> None:
    rows = ["0,50.5,0.1,NARROW_INT3", "1,50.5,0.1,SINGLE", "2,50.5,0.1,SINGLE2", "3,50.5,0.1,"]
    given = options(log(tmp_path, *rows, header="t,lat,lon,fix"), columns=PLACE, constants={})
    said = replayed(given, PositionReading)
    assert [m.fields["solution"] for m in said] == ["rtk_fixed", "single", "none", "none"]
    assert said[0].fields["longitude_deg"] == pytest.approx(math.degrees(0.1))


def test_an_empty_cell_is_a_field_that_was_not_said(tmp_path: Path) -> None:
    columns = {**PLACE, "altitude_m": {"column": "h", "unit": "m"}, "satellites": {"column": "n"}}
    path = log(tmp_path, "0,50,0.1,SINGLE,,", "1,50,0.1,SINGLE,12.5,9", header="t,lat,lon,fix,h,n")
    first, second = replayed(options(path, columns=columns, constants={}), PositionReading)
    assert set(first.fields) == {"latitude_deg", "longitude_deg", "solution"}
    assert (second.fields["altitude_m"], second.fields["satellites"]) == (12.5, 9)
    assert isinstance(second.fields["satellites"], int)


def test_a_count_that_is_no_number_is_a_mistake_with_its_place(tmp_path: Path) -> None:
    columns = {**PLACE, "satellites": {"column": "n"}}
    path = log(tmp_path, "0,50,0.1,SINGLE,inf", header="t,lat,lon,fix,n")
    with pytest.raises(ValueError, match=r"line 2: n: inf is not a whole number"):
        replayed(options(path, columns=columns, constants={}), PositionReading)


def test_a_variance_written_as_a_whole_number_shrinks_in_a_mean_too(tmp_path: Path) -> None:
    path = log(tmp_path, "0,36", "0.25,36", "0.5,36", "0.75,36", "1,36")
    whole, decimal = (replayed(options(path, constants={"speed_variance_m2ps2": said}, average_s=0.5)) for said in (1, 1.0))
    assert whole == decimal
    assert whole[1].fields["speed_variance_m2ps2"] == 0.5


INERTIAL = {
    "specific_force_mps2": [
        {"column": "x", "unit": "g"},
        {"column": "y", "unit": "m/s2"},
        {"column": "z", "unit": "g", "scale": -1.0},
    ],
    "turn_rate_radps": [{"column": c, "unit": "deg/s"} for c in ("p", "q", "r")],
}


def test_a_vector_is_several_columns_each_with_its_unit_and_sign(tmp_path: Path) -> None:
    path = log(tmp_path, "0,0.1,0.5,1.0,0,0,90", header="t,x,y,z,p,q,r")
    (said,) = replayed(options(path, columns=INERTIAL, constants={"mean_over_s": 0.01}), InertialReading)
    assert said.fields["specific_force_mps2"] == pytest.approx([0.980665, 0.5, -9.80665])
    assert said.fields["turn_rate_radps"] == pytest.approx([0.0, 0.0, math.pi / 2])


@pytest.mark.parametrize(
    ("unit", "stamps"),
    [
        ("s", ["5.0", "5.25", "6"]),
        ("ms", ["5000", "5250", "6000"]),
        ("us", ["5e6", "5.25e6", "6e6"]),
        ("ns", ["5000000000", "5250000000", "6000000000"]),
        ("iso8601", ["2022-02-25T09:00:05Z", "2022-02-25T09:00:05.250", "2022-02-25T10:00:06+01:00"]),
    ],
)
def test_times_are_read_in_their_unit_and_counted_from_the_first(tmp_path: Path, unit: str, stamps: list[str]) -> None:
    path = log(tmp_path, *(f"{t},36" for t in stamps))
    assert [m.measured_s for m in replayed(options(path, time={"column": "t", "unit": unit}))] == [0.0, 0.25, 1.0]


def test_a_stated_stamp_may_be_time_0_and_what_is_before_it_is_left_out(tmp_path: Path) -> None:
    path = log(tmp_path, "9.5,1", "10.5,2", "11,3")
    assert [m.measured_s for m in replayed(options(path, time={"column": "t", "zero_at": 10.0}))] == [0.5, 1.0]
    assert [m.measured_s for m in replayed(options(path, shift_s=100.0))] == [100.0, 101.0, 101.5]
    iso = log(tmp_path, "2022-02-25T09:00:05Z,1", name="iso.csv")
    time = {"column": "t", "unit": "iso8601", "zero_at": "2022-02-25T09:00:02Z"}
    assert [m.measured_s for m in replayed(options(iso, time=time))] == [3.0]


@pytest.mark.parametrize("average_s", [None, 0.25])
@pytest.mark.parametrize("from_s", [0.0, 0.3, 1.0, 3.7])
def test_a_source_opened_later_says_what_one_opened_at_the_start_says(tmp_path: Path, average_s: float, from_s: float) -> None:
    given = options(log(tmp_path, *(f"{0.1 * k:.1f},{k}" for k in range(50))), average_s=average_s)
    assert replayed(given, from_s=from_s) == [m for m in replayed(given) if m.measured_s >= from_s]


def test_a_row_that_is_not_after_the_one_before_is_skipped_counted_and_told(tmp_path: Path) -> None:
    path = log(tmp_path, "0,1", "1,2", "1,3", "0.5,4", "2,5")
    source = CsvSource(options(path), SpeedReading, 0.0)
    while source.next_s() is not None:
        source.read()
    assert source.skipped == {"out_of_order": 2}
    assert source.told["out_of_order"].startswith(f"{path}: line 4: t: ")


def test_means_of_several_rows_are_true_at_the_mean_of_their_times_with_the_variance_of_a_mean(tmp_path: Path) -> None:
    """Rows every 10 ms of v = 100 t km/h, means over 50 ms: five rows each, so a fifth of the variance."""
    path = log(tmp_path, *(f"{0.01 * k:.2f},{k}" for k in range(1, 101)))
    said = replayed(options(path, time={"column": "t", "zero_at": 0.0}, average_s=0.05))
    assert len(said) == 20
    assert [m.measured_s for m in said] == pytest.approx([0.03 + 0.05 * k for k in range(20)])
    for m in said:
        assert m.fields["speed_mps"] == pytest.approx(m.measured_s * 100.0 / 3.6)
        assert m.fields["speed_variance_m2ps2"] == pytest.approx(0.01 / 5)
        assert m.fields["interval_s"] == 0.05
    source = CsvSource(options(path, time={"column": "t", "zero_at": 0.0}, average_s=0.05), SpeedReading, 0.0)
    assert source.next_s() == pytest.approx(0.05)  # a mean is ready with its last row


def test_the_mean_of_courses_around_north_is_north_and_words_and_counts_are_the_last(tmp_path: Path) -> None:
    columns = {**PLACE, "course_deg": {"column": "c", "unit": "deg"}, "satellites": {"column": "n"}}
    path = log(tmp_path, "0.1,50,0.1,SINGLE,350,7", "0.2,51,0.1,NARROW_INT3,10,8", header="t,lat,lon,fix,c,n")
    given = options(path, columns=columns, constants={"horizontal_std_m": 2.0}, average_s=1.0, shift_s=0.5)
    (said,) = replayed(given, PositionReading)
    assert math.remainder(said.fields["course_deg"], 360.0) == pytest.approx(0.0, abs=1e-9)
    assert said.fields["latitude_deg"] == pytest.approx(50.5)
    assert (said.fields["solution"], said.fields["satellites"]) == ("rtk_fixed", 8)
    assert said.fields["horizontal_std_m"] == pytest.approx(math.sqrt(2.0))


def test_a_mark_at_the_beginning_and_spaces_in_cells_do_no_harm(tmp_path: Path) -> None:
    path = log(tmp_path, " 1.0 , 36 ", header="\ufefft,v")
    assert replayed(options(path))[0].fields["speed_mps"] == pytest.approx(10.0)


UNFIT: dict[str, tuple[dict[str, Any], str]] = {
    "a field that the message lacks": ({"columns": {"spede_mps": {"column": "v"}}}, "spede_mps: speed_reading has no"),
    "a constant that the message lacks": ({"constants": {"altitude_m": 1.0}}, "altitude_m: speed_reading has no"),
    "a field of the head": ({"constants": {"unit": "x"}}, "unit: speed_reading has no"),
    "a unit of another quantity": (
        {"columns": {"speed_mps": {"column": "v", "unit": "deg"}}},
        "speed_mps: deg is a unit of angle, speed_mps is a speed",
    ),
    "a unit that is none": ({"columns": {"speed_mps": {"column": "v", "unit": "ell"}}}, "speed_mps: the unit must be one of"),
    "no unit": ({"columns": {"speed_mps": {"column": "v"}}}, "speed_mps: give its unit, such as m/s"),
}


@pytest.mark.parametrize("name", UNFIT)
def test_a_map_that_does_not_fit_the_message_is_refused_before_the_file_is_read(tmp_path: Path, name: str) -> None:
    change, says = UNFIT[name]
    with pytest.raises(ValueError, match=r"columns\.") as caught:
        check_map(options(tmp_path / "not-there.csv", **change), SpeedReading)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_field_that_the_message_needs_must_be_given_unless_a_mean_has_it_anyway(tmp_path: Path) -> None:
    given = options(tmp_path / "x", columns=INERTIAL, constants={})
    with pytest.raises(ValueError, match="mean_over_s: inertial_reading needs it"):
        check_map(given, InertialReading)
    check_map(given.model_copy(update={"average_s": 0.05}), InertialReading)
    with pytest.raises(ValueError, match="solution: position_reading needs it"):
        check_map(
            options(tmp_path / "x", columns={k: v for k, v in PLACE.items() if k != "solution"}, constants={}), PositionReading
        )


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"invented": 1}, "Extra inputs"),
        ({"columns": {}}, "at least 1"),
        ({"columns": {"speed_mps": {"column": "v", "unit": "m/s", "factor": 2.0}}}, "Extra inputs"),
        ({"time": {"column": "t", "unit": "m"}}, "not a unit of time"),
        ({"time": {"column": "t", "zero_at": "noon"}}, "noon"),
        ({"constants": {"speed_mps": 1.0}}, "a column and a constant"),
        ({"average_s": 0.0}, "greater than 0"),
    ],
)
def test_options_that_cannot_be_are_refused(tmp_path: Path, change: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        options(tmp_path / "x", **change)


BROKEN = {
    "a word for a number": (["0,1", "1,fast"], "line 3: v: "),
    "not finite": (["0,1", "1,inf"], "line 3: v: "),
    "a time that is none": (["0,1", "1,2", "later,3"], "line 4: t: "),
    "a short row": (["0,1", "1"], "line 3: v: missing"),
    "no row": ([], "no row"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_cannot_be_read_is_named_by_file_line_and_column_at_once(tmp_path: Path, name: str) -> None:
    rows, says = BROKEN[name]
    path = log(tmp_path, *rows)
    with pytest.raises(ValueError, match=r"log\.csv") as caught:
        CsvSource(options(path), SpeedReading, 0.0)
    assert str(caught.value).startswith(f"{path}: {says}")


def test_a_column_that_is_not_there_is_named_with_those_that_are(tmp_path: Path) -> None:
    path = log(tmp_path, "0,1", header="t,speed")
    with pytest.raises(ValueError, match=r"line 1: v: missing; there are t, speed"):
        CsvSource(options(path), SpeedReading, 0.0)


def test_a_first_reading_that_is_no_message_is_refused_with_the_messages_own_words(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="the first reading: speed_mps and speed_variance_m2ps2 go together"):
        CsvSource(options(log(tmp_path, "0,1"), constants={}), SpeedReading, 0.0)


@pytest.mark.parametrize("kind", sorted(SENSORS))
def test_every_kind_of_sensor_can_be_replayed_from_a_log(tmp_path: Path, kind: str) -> None:
    message = BY_NAME[SENSORS[kind].stream].message
    columns, header, row = {
        SpeedReading: (SPEED, "t,v", "0,36"),
        PositionReading: (PLACE, "t,lat,lon,fix", "0,50,0.1,SINGLE"),
        InertialReading: (INERTIAL, "t,x,y,z,p,q,r", "0,0,0,1,0,0,0"),
    }.get(message, ({"balise_id": {"column": "id"}}, "t,id", "0,b1"))
    constants = {SpeedReading: VARIANCE, InertialReading: {"mean_over_s": 0.01}, PositionReading: {}}.get(
        message, {"reader_variance_m2": 4e-4}
    )
    entry = {
        "file": str(log(tmp_path, row, header=header)),
        "time": {"column": "t"},
        "columns": columns,
        "constants": constants,
    }
    row_of = sensor(kind, straight_line(), "unit", source="recording", recording=entry)
    source = row_of.source(None, 0.0)
    message(**head(), **source.read().fields)
    assert source.next_s() is None
