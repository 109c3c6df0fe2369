"""Logs of many shapes become trains that run, and what cannot be guessed is one line."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from milepost.cli.importing.job import run_import
from milepost.config.errors import ConfigError
from milepost.config.scenario_file import load_scenario
from milepost.offline.run import simulate
from milepost.recordings.importing.figures import courses
from milepost.recordings.importing.names import unit_in, words_of
from milepost.recordings.importing.rows import Rows
from milepost.recordings.importing.solutions import meaning_of
from milepost.recordings.importing.times import time_format
from milepost.track.earth import moved
from rides import BEGAN_S, SECONDS, SPEED_MPS, iso, ride, write


def comma(value: float, digits: int) -> str:
    return f"{value:.{digits}f}".replace(".", ",")


def epoch_seconds() -> list[str]:
    rows = [f"{BEGAN_S + a.t:.1f},{a.lat:.7f},{a.lon:.7f},{SPEED_MPS * 3.6:.1f}" for a in ride()]
    return ["Timestamp,Lat,Lon,Speed (km/h)", *rows]


def german() -> list[str]:
    rows = [f"{iso(a.t)};{comma(a.lat, 7)};{comma(a.lon, 7)};{comma(54.0, 1)};{comma(3.0, 1)}" for a in ride()]
    return ["Zeit;Breite;Länge;Geschwindigkeit_kmh;Accuracy", *rows]


def nmea_quality_repeated() -> list[str]:
    """A log at 10 Hz of a receiver that makes a fix a second."""
    fixes = ride()
    rows = [f"{i * 100},{fixes[i // 10].lat:.7f},{fixes[i // 10].lon:.7f},4,12" for i in range(10 * SECONDS)]
    return ["time_ms,latitude,longitude,gps_quality,numSV", *rows]


def date_and_time() -> list[str]:
    clock = [datetime.fromtimestamp(BEGAN_S + a.t, UTC) for a in ride()]
    rows = [f"{c:%d.%m.%Y}\t{c:%H:%M:%S}\t{a.lat:.7f}\t{a.lon:.7f}\t{29.158:.3f}\t" for c, a in zip(clock, ride(), strict=True)]
    return ["# exported by a logger", "Date\tTime\tLatitude [deg]\tLongitude [deg]\tSOG [kn]\tremark", *rows]


def one_log_of_two_devices() -> list[str]:
    """Fixes once a second, a wheel ten times, in one table with empty cells."""
    fixes, rows = ride(noise_m=0.02), []
    for i in range(10 * SECONDS):
        place = f"{fixes[i // 10].lat:.7f},{fixes[i // 10].lon:.7f},RTK fixed" if i % 10 == 0 else ",,"
        rows.append(f"{BEGAN_S * 1000 + i * 100:.0f},{place},{SPEED_MPS * 3.6 * 1.01:.1f}")
    return ["epoch,lat,lon,status,wheelSpeedKmh", *rows]


def imported(folder: Path, log: Path, capsys: pytest.CaptureFixture[str], *column: str, line: Path | None = None) -> dict:
    capsys.readouterr()
    assert run_import([log], line, folder / "out", column, [], False, True) == 0
    return json.loads(capsys.readouterr().out)


def end_of(folder: Path) -> tuple[float, float, set[str]]:
    """Where a train ends and how fast, and the units in use."""
    scenario, train = load_scenario(folder / "out/scenario.yaml")
    states: list = []
    simulate(train, scenario.duration_s, None, states.append)
    last = states[-1]
    return last.position_m, last.speed_mps, {sensor.unit for sensor in last.sensors if sensor.share > 0.0}


SHAPES: dict[str, tuple[Callable[[], list[str]], dict[str, tuple[str, str]], set[str]]] = {
    "epoch seconds": (epoch_seconds, {"time": ("Timestamp", "s"), "speed": ("Speed (km/h)", "km/h")}, {"gnss"}),
    "semicolons and decimal commas": (
        german,
        {
            "time": ("Zeit", "iso8601"),
            "longitude": ("Länge", "deg"),
            "speed": ("Geschwindigkeit_kmh", "km/h"),
            "accuracy": ("Accuracy", "m"),
        },
        {"gnss"},
    ),
    "NMEA quality, repeated": (
        nmea_quality_repeated,
        {"time": ("time_ms", "ms"), "solution": ("gps_quality", ""), "satellites": ("numSV", "1")},
        {"gnss"},
    ),
    "date and time": (
        date_and_time,
        {"time": ("Time", "%d.%m.%Y %H:%M:%S"), "latitude": ("Latitude [deg]", "deg"), "speed": ("SOG [kn]", "kn")},
        {"gnss"},
    ),
    "two devices": (
        one_log_of_two_devices,
        {"time": ("epoch", "ms"), "solution": ("status", ""), "wheel": ("wheelSpeedKmh", "km/h")},
        {"gnss", "odometer"},
    ),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_a_log_of_any_shape_becomes_a_train_that_runs(shape: str, tmp_path: Path, capsys) -> None:
    lines, expected, units = SHAPES[shape]
    said = imported(tmp_path, write(tmp_path, lines()), capsys)
    found = {row["field"]: (row["column"], row["unit"]) for row in said["columns"]}
    assert expected.items() <= found.items()
    assert set(said["units"]) == units
    position_m, speed_mps, used = end_of(tmp_path)
    assert used == units
    assert position_m == pytest.approx(SPEED_MPS * said["duration_s"], abs=6.0)
    assert speed_mps == pytest.approx(SPEED_MPS, abs=0.7)


def test_repeated_fixes_are_thinned_and_counted(tmp_path: Path, capsys) -> None:
    said = imported(tmp_path, write(tmp_path, nmea_quality_repeated()), capsys)
    assert said["fixes"] == SECONDS
    assert said["left_out"] == {"a fix again": 9 * SECONDS}
    assert any("a fix stands in 10 rows" in each for each in said["told"])
    assert said["solutions"] == {"rtk_fixed": SECONDS}


def test_a_log_that_can_be_read_as_it_is_is_named_and_not_copied(tmp_path: Path, capsys) -> None:
    rows = [f"{iso(a.t)},{a.lat:.8f},{a.lon:.8f},NARROW_INT" for a in ride()]
    said = imported(tmp_path, write(tmp_path, ["time,latitude,longitude,position_type", *rows]), capsys)
    assert [Path(each).name for each in said["files"]] == ["train.yaml", "scenario.yaml", "line.yaml", "line.geojson"]
    assert "file: ../My Run.csv" in (tmp_path / "out/train.yaml").read_text(encoding="utf-8")
    assert end_of(tmp_path)[0] == pytest.approx(SPEED_MPS * SECONDS, abs=3.0)


def test_a_copy_says_why_it_is_one(tmp_path: Path, capsys) -> None:
    imported(tmp_path, write(tmp_path, german()), capsys)
    text = (tmp_path / "out/train.yaml").read_text(encoding="utf-8")
    assert "# a copy of My Run.csv: `;` between columns; decimal commas; courses computed from the places" in text
    assert (
        (tmp_path / "out/recorded-gnss.csv").read_text(encoding="utf-8").startswith("t_s,latitude_deg,longitude_deg,speed_mps,")
    )


def test_a_speed_that_no_train_has_is_left_out_and_changes_nothing_else(tmp_path: Path, capsys) -> None:
    sane, lines = tmp_path / "sane", epoch_seconds()
    sane.mkdir()
    imported(sane, write(sane, lines), capsys)
    garbage = [*lines[:30], lines[30].rpartition(",")[0] + ",999999", *lines[31:]]
    said = imported(tmp_path, write(tmp_path, garbage), capsys)
    assert said["left_out"] == {"faster than 200 m/s": 1}
    assert any("1 rows faster than 200 m/s" in each for each in said["told"])
    jerks = [re.search("jerk_psd.*", (folder / "out/train.yaml").read_text(encoding="utf-8"))[0] for folder in (sane, tmp_path)]
    assert jerks[0] == jerks[1]


def test_courses_are_computed_over_ways_that_are_long_beside_the_noise_of_fixes() -> None:
    """On a circle, 3 m from fix to fix, 1 m of noise: the cosine of the error is what is left of a speed along the line."""
    rng, t = np.random.default_rng(1), np.arange(0.0, 100.0, 0.2)
    angle = 15.0 * t / 2000.0
    north, east = 2000.0 * np.sin(angle) + rng.normal(size=len(t)), 2000.0 * (1.0 - np.cos(angle)) + rng.normal(size=len(t))
    places = [moved(50.0, 4.0, e, n) for n, e in zip(north, east, strict=True)]
    latitude, longitude = np.array(places).T
    values = {"latitude": latitude, "longitude": longitude, "speed": np.full(len(t), 15.0)}
    found = np.radians(courses(Rows(t, values, ["single"] * len(t), {})))
    assert np.count_nonzero(np.isfinite(found)) > 0.95 * len(t)
    assert 1.0 - np.nanmean(np.cos(found - angle)) < 0.002


def test_a_train_that_goes_back_keeps_its_longest_part(tmp_path: Path, capsys) -> None:
    rows = [f"{a.t},{a.lat:.8f},{a.lon:.8f}" for a in ride(turn_at_s=40.0)]
    said = imported(tmp_path, write(tmp_path, ["t,lat,lon", *rows]), capsys)
    assert said["duration_s"] == pytest.approx(40.0, abs=4.0)
    assert said["line_length_m"] == pytest.approx(600.0, abs=60.0)
    assert any("comes back to where it was, in 2 parts" in each for each in said["told"])


def test_a_line_file_is_used(tmp_path: Path, capsys) -> None:
    coordinates = [[a.lon, a.lat] for a in ride(noise_m=0.0)]
    geometry = {"type": "LineString", "coordinates": coordinates}
    (tmp_path / "track.geojson").write_text(json.dumps(geometry), encoding="utf-8")
    line = tmp_path / "mine.yaml"
    line.write_text("line: mine\ngeojson: track.geojson\n", encoding="utf-8")
    imported(tmp_path, write(tmp_path, epoch_seconds()), capsys, line=line)
    assert "line: ../mine.yaml" in (tmp_path / "out/train.yaml").read_text(encoding="utf-8")
    assert not (tmp_path / "out/line.yaml").exists()
    assert end_of(tmp_path)[0] == pytest.approx(SPEED_MPS * SECONDS, abs=3.0)


def refused(folder: Path, lines: Sequence[str], *column: str, unit: Sequence[str] = (), line: Path | None = None) -> str:
    """What is said of a log that is no train: one line, and nothing is written."""
    with pytest.raises(ConfigError) as error:
        run_import([write(folder, lines)], line, folder / "out", column, unit, False, True)
    assert not (folder / "out").exists()
    assert len(str(error.value).splitlines()) == 1
    return str(error.value).removeprefix(f"{folder / 'My Run.csv'}: ")


def test_what_cannot_be_guessed_is_one_line_with_the_columns_that_are_there(tmp_path: Path) -> None:
    lines = ["when,x,y", "1,50.1,4.1", "2,50.2,4.2"]
    there = "no column is known for it; there are when, x, y: name it with"
    assert refused(tmp_path, lines) == f"time: {there} --column time=COLUMN"
    assert refused(tmp_path, lines, "time=when") == f"latitude: {there} --column latitude=COLUMN"
    assert refused(tmp_path, lines, "time=wen") == "--column time: there is no column 'wen'; there are when, x, y"
    assert "there is no field 'latitud'; did you mean 'latitude'?" in refused(tmp_path, lines, "latitud=x")
    assert "--unit speed: must be one of m/s, km/h" in refused(tmp_path, lines, unit=["speed=furlong"])


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        ([""], "no table: neither a header nor rows"),
        (["a b c", "1 2 3"], "no table: its first line is not divided"),
        (["1.5,50.1,4.2", "2.5,50.2,4.3"], "no header: the first line is 1.5, 50.1, 4.2"),
        (["t,lat,lat", "1,2,3"], "two columns are called lat"),
        (["t,lat,lon", *(f"{t},50.1,4.2" for t in range(30))], "no line can be made: the train does not move"),
        (["t,lat,lon", "1,50.1,4.2", "2,50.2,4.3"], "only 2 fixes; left out: nothing"),
        (["t,lat,lon,quality", *(f"{t},{50 + t / 1e4},4.2,{t % 2 * 6}" for t in range(30))], "solution: no fix counts"),
    ],
)
def test_a_log_that_is_no_train_is_one_line(lines: list[str], says: str, tmp_path: Path) -> None:
    assert refused(tmp_path, lines).startswith(says)


def test_a_column_of_the_right_name_whose_values_do_not_fit_is_named(tmp_path: Path) -> None:
    lines = ["time,latitude,longitude", *(f"{t},{503000000 + t},{41000000 + t}" for t in range(30))]
    assert refused(tmp_path, lines) == (
        "latitude: the column latitude does not hold it, by its values 503000000, 503000001, 503000002: name another one with "
        "--column latitude=COLUMN, or the unit with --unit latitude=UNIT"
    )
    lines = ["time,lat,lon", *(f"at {t},50.{t},4.2" for t in range(30))]
    assert refused(tmp_path, lines).startswith("time: the column time does not hold it, by its values at 0, at 1, at 2: ")


@pytest.mark.parametrize(
    ("head", "kind"),
    [
        (b"$GNRMC,120000.00,A,5051.0,N,00421.0,E,29.1,90.0,010624,,,A*7C\r\n$GNGGA,120000.00,5051.0,N*00\r\n", "NMEA"),
        (b"\xb5\x62\x01\x07\x5c\x00" + bytes(92) + b"\xb5\x62\x01\x07", "UBX"),
    ],
)
def test_a_receivers_own_log_is_no_table_and_the_advice_fits(head: bytes, kind: str, tmp_path: Path) -> None:
    path = tmp_path / "log.bin"
    path.write_bytes(head * 20)
    with pytest.raises(ConfigError, match=f"is a receiver's own {kind} log, which needs no import: .*protocol: {kind.lower()}"):
        run_import([path], None, tmp_path / "out", [], [], False, True)


def test_times_in_milliseconds_without_a_unit_are_one_line(tmp_path: Path) -> None:
    """By its numbers 100, 200, 300 a time may be in seconds: the speeds beside the places tell."""
    lines = ["time,lat,lon,speed_mps", *(f"{1000 * a.t:.0f},{a.lat:.7f},{a.lon:.7f},15.0" for a in ride())]
    assert refused(tmp_path, lines) == "time: by the places and the speeds its column time is in ms: say --unit time=ms"
    run_import([write(tmp_path, lines)], None, tmp_path / "said", [], ["time=ms"], False, False)
    # nothing tells
    lines = ["time,lat,lon", *(f"{100_000 * a.t:.0f},{a.lat:.7f},{a.lon:.7f}" for a in ride())]
    assert "; is its time in another unit? --unit time=ms" in refused(tmp_path, lines)


@pytest.mark.parametrize(("factor", "off_deg"), [(1.0, 180.0), (math.pi / 180.0, 0.0), (1.0, -90.0)])
def test_a_course_that_the_places_contradict_is_not_used(factor: float, off_deg: float, tmp_path: Path, capsys) -> None:
    """In radians, against the way or across it: with the speed it would say that the train goes back, or stands."""
    places = [(t, *moved(50.9, 4.5, 10.6 * t, 10.6 * t)) for t in range(120)]
    rows = [f"{t},{lat:.7f},{lon:.7f},54.0,{(45.0 + off_deg) * factor:.4f}" for t, lat, lon in places]
    said = imported(tmp_path, write(tmp_path, ["t,lat,lon,speed_kmh,course", *rows]), capsys)
    assert any(each.startswith("the column course is not used: ") for each in said["told"])
    position_m, speed_mps, used = end_of(tmp_path)
    assert used == {"gnss"}
    assert position_m == pytest.approx(15.0 * said["duration_s"], abs=10.0)
    assert speed_mps == pytest.approx(15.0, abs=0.7)


def test_a_log_that_is_named_twice_is_one_line(tmp_path: Path) -> None:
    log = write(tmp_path, epoch_seconds())
    with pytest.raises(ConfigError, match=r"My Run\.csv: is named twice$"):
        run_import([log, tmp_path / "." / log.name], None, tmp_path / "out", (), (), False, True)
    assert not (tmp_path / "out").exists()


def test_fixes_far_from_the_line_are_one_line(tmp_path: Path) -> None:
    geometry = {"type": "LineString", "coordinates": [[5.0, 51.5], [5.1, 51.5]]}
    (tmp_path / "track.geojson").write_text(json.dumps(geometry), encoding="utf-8")
    line = tmp_path / "mine.yaml"
    line.write_text("line: mine\ngeojson: track.geojson\n", encoding="utf-8")
    assert refused(tmp_path, epoch_seconds(), line=line).startswith("half of the fixes lie ")


def test_columns_and_units_are_as_somebody_says(tmp_path: Path, capsys) -> None:
    rows = [f"{a.t},{a.lat:.7f},{a.lon:.7f},54.0,15.0" for a in ride()]
    log = write(tmp_path, ["clock,p,q,speed,r", *rows])
    run_import([log], None, tmp_path / "out", ["time=clock", "lat=p", "longitude=q"], ["speed=kph"], False, True)
    found = {row["field"]: (row["column"], row["unit"]) for row in json.loads(capsys.readouterr().out)["columns"]}
    assert found == {"time": ("clock", "s"), "latitude": ("p", "deg"), "longitude": ("q", "deg"), "speed": ("speed", "km/h")}
    run_import([log], None, tmp_path / "two", ["time=clock", "lat=p", "lon=q", "speed="], [], False, True)
    assert json.loads(capsys.readouterr().out)["unused"] == ["speed", "r"]


@pytest.mark.parametrize(("number", "unit"), [(15.0, "m/s"), (54.0, "km/h"), (33.55, "mph"), (29.16, "kn"), (1500.0, "cm/s")])
def test_a_speed_without_a_unit_has_the_one_that_the_places_show(number: float, unit: str, tmp_path: Path, capsys) -> None:
    rows = [f"{a.t},{a.lat:.7f},{a.lon:.7f},{number}" for a in ride(5.0)]
    log = write(tmp_path, ["t,lat,lon,speed", *rows])
    run_import([log], None, tmp_path / "out", [], [], False, True)
    (speed,) = [row for row in json.loads(capsys.readouterr().out)["columns"] if row["field"] == "speed"]
    assert (speed["unit"], speed["found"]) == (unit, f"by name, {unit} as the places show")


def test_a_speed_that_no_unit_fits_to_the_places_says_so(tmp_path: Path, capsys) -> None:
    rows = [f"{a.t},{a.lat:.7f},{a.lon:.7f},5.0" for a in ride(5.0)]
    log = write(tmp_path, ["t,lat,lon,speed", *rows])
    run_import([log], None, tmp_path / "out", [], [], False, True)
    (speed,) = [row for row in json.loads(capsys.readouterr().out)["columns"] if row["field"] == "speed"]
    assert speed["unit"] == "m/s"
    assert "the places show 3 m/s for each 1: say --unit speed=UNIT" in speed["found"]


def test_a_speed_that_is_not_in_the_unit_of_its_name_is_one_line(tmp_path: Path) -> None:
    lines = ["t,lat,lon,speed_mps", *(f"{a.t},{a.lat:.7f},{a.lon:.7f},54.0" for a in ride(5.0))]
    says = "speed: the column speed_mps is in m/s by its name, but the places show km/h: say which with --unit speed=UNIT"
    assert refused(tmp_path, lines).endswith(says)
    # somebody knows better
    run_import([write(tmp_path, lines)], None, tmp_path / "said", [], ["speed=m/s"], False, False)


def test_latitude_and_longitude_that_are_exchanged_are_one_line(tmp_path: Path) -> None:
    """A ride to the east at 51°: with the two exchanged it would be half as far again as the speeds tell."""
    places = [(t, *moved(50.9, 4.5, 15.0 * t, 0.0)) for t in range(120)]
    lines = ["t,lat,lon,speed_kmh", *(f"{t},{lon:.7f},{lat:.7f},54.0" for t, lat, lon in places)]
    assert "the two are exchanged: say --column latitude=lon --column longitude=lat" in refused(tmp_path, lines)


def test_a_cell_that_is_no_time_costs_its_row_alone(tmp_path: Path, capsys) -> None:
    rows = [f"{'###' if i == 7 else a.t},{a.lat:.7f},{a.lon:.7f}" for i, a in enumerate(ride())]
    said = imported(tmp_path, write(tmp_path, ["t,lat,lon", *rows]), capsys)
    assert said["left_out"] == {"no time": 1}
    position_m, _, used = end_of(tmp_path)
    assert used == {"gnss"}
    assert position_m == pytest.approx(SPEED_MPS * said["duration_s"], abs=6.0)


def test_cells_that_are_no_numbers_are_counted_by_column(tmp_path: Path, capsys) -> None:
    lines = epoch_seconds()
    for at, text in ((5, "n/a"), (9, "12.x"), (12, ""), (13, "nan")):
        lines[at] = f"{lines[at].rpartition(',')[0]},{text}"
    made = imported(tmp_path, write(tmp_path, lines), capsys)
    assert "no numbers in the column Speed (km/h): 2 cells, the first is 'n/a'" in made["told"]


@pytest.mark.parametrize(("letters", "field", "column"), [("S,E", "latitude", "Lat"), ("N,W", "longitude", "Lon")])
def test_a_hemisphere_in_a_column_of_its_own_is_one_line(letters: str, field: str, column: str, tmp_path: Path) -> None:
    lines = ["t,Lat,ns,Lon,ew", *(f"{a.t},{a.lat:.7f},{letters[0]},{a.lon:.7f},{letters[2]}" for a in ride())]
    letter = letters.strip("NE,")
    name = "ns" if letter == "S" else "ew"
    says = f"{field}: the column {name} says {letter}, which is not read: write {letter} as a minus in {column}"
    assert says in refused(tmp_path, lines)


def test_hemispheres_that_agree_with_the_signs_are_no_matter(tmp_path: Path, capsys) -> None:
    lines = ["t,Lat,ns,Lon,ew", *(f"{a.t},{a.lat:.7f},N,{a.lon:.7f},E" for a in ride())]
    assert imported(tmp_path, write(tmp_path, lines), capsys)["fixes"] == SECONDS + 1


@pytest.mark.parametrize(("name", "letters"), [("direction", "SS"), ("way", "NS")])
def test_the_direction_of_travel_is_no_hemisphere(name: str, letters: str, tmp_path: Path, capsys) -> None:
    """A train that goes south at 51° north, and one that turns round."""
    lines = [f"t,Lat,Lon,{name}", *(f"{a.t},{a.lat:.7f},{a.lon:.7f},{letters[a.t > 30.0]}" for a in ride())]
    assert imported(tmp_path, write(tmp_path, lines), capsys)["fixes"] == SECONDS + 1


def test_a_clock_that_is_set_by_more_than_a_day_is_one_line(tmp_path: Path) -> None:
    """A receiver that began in 1970: the years until it knew the time would be scenario time."""
    lines = ["t,lat,lon", *(f"{a.t + (0.0 if i < 10 else BEGAN_S):.1f},{a.lat:.7f},{a.lon:.7f}" for i, a in enumerate(ride()))]
    assert "time: jumps by 1700000001 s after 9 s: the logger's clock was set there; cut the log there" in refused(
        tmp_path, lines
    )


def test_rows_of_a_wheel_that_are_left_out_are_counted(tmp_path: Path, capsys) -> None:
    """A logger whose clock is set back by three seconds."""
    wheel = tmp_path / "wheel.csv"
    times = [BEGAN_S + a.t - (3.0 if a.t > 30.0 else 0.0) for a in ride()]
    wheel.write_text("\n".join(["timestamp,wheel_speed_mps", *(f"{t:.1f},15.0" for t in times)]) + "\n", encoding="utf-8")
    log = write(tmp_path, epoch_seconds())
    run_import([log, wheel], None, tmp_path / "out", [], [], False, True)
    assert "left out of wheel_speed_mps: 3 rows not after the row before" in json.loads(capsys.readouterr().out)["told"]


def test_a_receivers_speeds_that_are_negative_are_one_line(tmp_path: Path) -> None:
    lines = [epoch_seconds()[0], *(f"{line.rpartition(',')[0]},-54.0" for line in epoch_seconds()[1:])]
    says = "speed: the column Speed (km/h) is negative in 61 of 61 rows: a receiver's speed is along its way"
    assert says in refused(tmp_path, lines)


def test_a_gap_in_the_log_is_told(tmp_path: Path, capsys) -> None:
    """The clock of a logger that is set forward by a minute looks the same."""
    rows = [f"{BEGAN_S + a.t + (60.0 if a.t > 30.0 else 0.0):.1f},{a.lat:.7f},{a.lon:.7f}" for a in ride()]
    made = imported(tmp_path, write(tmp_path, ["Timestamp,Lat,Lon", *rows]), capsys)
    assert "the longest gap is of 61 s, after 30 s: there the receiver was silent, or its clock was set" in made["told"]
    whole = imported(tmp_path / "b", write(tmp_path, epoch_seconds()), capsys)
    assert not [each for each in whole["told"] if "gap" in each]


def test_no_file_is_overwritten_without_being_told_to(tmp_path: Path, capsys) -> None:
    log = write(tmp_path, epoch_seconds())
    imported(tmp_path, log, capsys)
    train = tmp_path / "out/train.yaml"
    train.write_text("mine", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"train\.yaml: is there already; --force"):
        run_import([log], None, tmp_path / "out", [], [], False, True)
    assert train.read_text(encoding="utf-8") == "mine"
    run_import([log], None, tmp_path / "out", [], [], True, True)
    assert train.read_text(encoding="utf-8") != "mine"
    copy = log.rename(tmp_path / "out/recorded-gnss.csv")
    with pytest.raises(ConfigError, match="is a log itself"):
        run_import([copy], None, tmp_path / "out", [], [], True, True)


@pytest.mark.parametrize(
    ("name", "quantity", "unit"),
    [
        ("speed_kmh", "speed", "km/h"), ("Speed (kph)", "speed", "km/h"), ("gps.speed.m/s", "speed", "m/s"),
        ("speed_ms", "speed", "m/s"),
        ("SOG [knots]", "speed", "kn"), ("GPSSpeed_mph", "speed", "mph"), ("speed", "speed", None), ("utc_ms", "time", "ms"),
        ("height ft", "length", "ft"), ("accZ_mps2", "acceleration", "m/s2"), ("gyro x deg/s", "turn rate", "deg/s"),
    ],
)  # fmt: skip
def test_a_unit_is_read_from_the_name(name: str, quantity: str, unit: str | None) -> None:
    assert unit_in(words_of(name), quantity)[0] == unit


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("1700000000", "s"), ("1700000000123", "ms"), ("1700000000123456", "us"), ("1700000000123456789", "ns"), ("12.5", "s"),
        ("2023-11-14T22:13:20Z", "iso8601"), ("2023-11-14 22:13:20.5", "iso8601"),
        ("14.11.2023 22:13:20,5", "%d.%m.%Y %H:%M:%S"),
        ("22:13:20.25", "hh:mm:ss"), ("soon", None),
    ],
)  # fmt: skip
def test_a_time_is_read_from_its_text(text: str, unit: str | None) -> None:
    found = time_format([text], None)
    assert (found.unit if found else None) == unit


@pytest.mark.parametrize(
    ("column", "texts", "meant"),
    [
        ("quality", ["0", "1", "4", "5"], ["none", "single", "rtk_fixed", "rtk_float"]),
        ("Fix Type", ["3", "2", "0"], ["single", "single", "none"]),
        ("position_type", ["NARROW_INT3", "PROPAGATED", "SINGLE"], ["rtk_fixed", "propagated", "single"]),
        ("solution", ["RTK fixed", "Float", "DGPS"], ["rtk_fixed", "rtk_float", "differential"]),
        ("mode", ["A", "D"], ["single", "differential"]),
        ("solution_status", ["SOL_COMPUTED", "SOL_COMPUTED"], None),
    ],
)
def test_a_solution_is_read_from_words_and_numbers(column: str, texts: list[str], meant: list[str] | None) -> None:
    meaning = meaning_of(column, [column], texts)
    assert (None if meaning is None else [meaning.of(text) for text in texts]) == meant
