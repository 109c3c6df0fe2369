"""Motions that recordings show: a path in earth-centred metres, a GNSS log with a column map, and rows that show none."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pyproj
import pytest

from examples import REMOVED, write_train
from milepost.config.line_file import load_line
from milepost.config.train import Train, load_train
from milepost.config.yaml_files import ConfigError
from milepost.simulation.recorded_motion import path_motion

START = datetime(2022, 2, 25, tzinfo=UTC)
# metres of a degree of longitude and of latitude at latitude 50.9
LON_M, LAT_M = 70_310.0, 111_230.0
HEADER = "time_utc,latitude_deg,longitude_deg,position_type"
OWN_HEADER = "t,lat,lon,quality"
OWN_MAP: dict[str, Any] = {
    "file": "log.csv",
    "time": {"column": "t", "unit": "ms"},
    "columns": {
        "latitude_deg": {"column": "lat", "unit": "1e-7 deg"},
        "longitude_deg": {"column": "lon", "unit": "1e-7 deg"},
        "solution": {"column": "quality", "values": {"4": "rtk_fixed", "*": "single"}},
    },
}
RECORDED: dict[str, Any] = {"kind": "recorded", "gnss_log": "log.csv"}


def row(t_s: float, east_m: float, word: str = "NARROW_INT", north_m: float = 0.0) -> str:
    stamp = (START + timedelta(seconds=t_s)).isoformat()
    return f"{stamp},{50.9 + north_m / LAT_M:.10f},{4.5 + east_m / LON_M:.10f},{word}"


def own_row(t_s: float, east_m: float, quality: int = 4) -> str:
    return f"{1000.0 * t_s:.0f},{50.9e7:.0f},{(4.5 + east_m / LON_M) * 1e7:.2f},{quality}"


def train_of(folder: Path, rows: Iterable[str], motion: dict[str, Any], header: str = HEADER, **changes: Any) -> Train:
    """A train whose truth is a log, on a line due east from where the log begins."""
    (folder / "log.csv").write_text("\n".join([header, *rows]), encoding="utf-8")
    (folder / "l.geojson").write_text('{"type": "LineString", "coordinates": [[4.5, 50.9], [4.6, 50.9]]}', encoding="utf-8")
    line = {"geojson": "l.geojson", "length_m": REMOVED}
    return load_train(write_train(folder, {"world.motion": motion, **changes}, line))


def refusal(make: Callable[[], Any]) -> str:
    with pytest.raises(ConfigError) as refused:
        make()
    text = str(refused.value)
    assert len(text.splitlines()) == 1
    return text


TO_ECEF = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)


def ecef(east_m: float, north_m: float) -> tuple[float, float, float]:
    x, y, z = TO_ECEF.transform(4.5 + east_m / LON_M, 50.9 + north_m / LAT_M, 50.0)
    return x, y, z


def path_rows(places: list[tuple[float, float]], dt_s: float) -> list[str]:
    """Rows of a path through places east and north, with the velocity to the next one."""
    out = []
    for k, (here, there) in enumerate(zip(places, [*places[1:], places[-1]], strict=True)):
        a, b = ecef(*here), ecef(*there)
        out.append(",".join(f"{value:.6f}" for value in (k * dt_s, *a, *((q - p) / dt_s for p, q in zip(a, b, strict=True)))))
    return out


def path_train(folder: Path, rows: list[str]) -> Train:
    """A train on the very path that its truth took."""
    header = "t_s,ecef_x_m,ecef_y_m,ecef_z_m,ecef_vx_mps,ecef_vy_mps,ecef_vz_mps"
    (folder / "path.csv").write_text("\n".join([header, *rows]), encoding="utf-8")
    motion = {"kind": "recorded_path", "path_csv": "path.csv"}
    return load_train(write_train(folder, {"world.motion": motion}, {"path_csv": "path.csv", "length_m": REMOVED}))


def test_a_recorded_path_becomes_a_motion_along_its_line(tmp_path: Path) -> None:
    """Due north on the equator's meridian 0 at 10 m/s, then 12: chainage and speed are those of the file."""
    rows = ["t_s,ecef_x_m,ecef_y_m,ecef_z_m,ecef_vx_mps,ecef_vy_mps,ecef_vz_mps"]
    z = 0.0
    for k in range(60):
        v = 10.0 if k < 30 else 12.0
        rows.append(f"{100.0 + k},{6378137.0},0.0,{z},0.0,0.0,{v}")
        z += v
    path = tmp_path / "path.csv"
    path.write_text("\n".join(rows), encoding="utf-8")
    (tmp_path / "line.yaml").write_text("line: path\npath_csv: path.csv\n", encoding="utf-8")
    track = load_line(tmp_path / "line.yaml").track
    assert track is not None
    motion = path_motion(path, track)
    assert motion.end_s == 59.0
    assert motion.at(10.0)[:2] == pytest.approx((100.0, 10.0), abs=1e-3)
    assert motion.at(45.0)[:2] == pytest.approx((300.0 + 15 * 12.0, 12.0), abs=1e-3)


def test_fixes_that_are_not_trusted_show_no_motion(tmp_path: Path) -> None:
    """A log whose middle calls itself RTK and stands still: without those spans the train rolls on at 10 m/s."""
    rows = [row(k, 200.0 if 20 <= k < 80 else 10.0 * k) for k in range(100)]
    train = train_of(tmp_path, rows, RECORDED | {"untrusted_s": [[20.0, 80.0]]})
    s, v, _ = train.world().motion.at(50.0)
    assert s == pytest.approx(500.0, abs=1.0)
    assert v == pytest.approx(10.0, abs=0.1)


class TestColumnMap:
    def test_a_log_in_own_columns_and_units_shows_the_motion(self, tmp_path: Path) -> None:
        """Time in ms from 100 s on, scenario time 0 at 103 s, and fixes of quality 1 far away."""
        rows = [own_row(100.0 + k, 10.0 * k if k % 5 else 9000.0, 4 if k % 5 else 1) for k in range(60)]
        log = OWN_MAP | {"time": {"column": "t", "unit": "ms", "zero_at": 103_000.0}}
        motion = train_of(tmp_path, rows, RECORDED | {"gnss_log": log}, OWN_HEADER).world().motion
        assert motion.at(20.0)[:2] == pytest.approx((230.0, 10.0), abs=0.5)
        assert motion.end_s == 56.0

    @pytest.mark.parametrize(
        ("spoil", "says"),
        [
            (
                {"columns": {"latitude_deg": {"column": "lat", "unit": "deg"}}},
                "columns.longitude_deg: position_reading needs it",
            ),
            ({"constants": {"mass_kg": 4.0}}, "columns.mass_kg: position_reading has no such field"),
            ({"file": "none.csv"}, "none.csv"),
            ({"time": {"column": "clock", "unit": "ms"}}, "line 1: clock: missing"),
        ],
    )
    def test_a_wrong_map_is_one_line_naming_the_field(self, tmp_path: Path, spoil: dict[str, Any], says: str) -> None:
        motion = RECORDED | {"gnss_log": OWN_MAP | spoil}
        text = refusal(lambda: train_of(tmp_path, [own_row(k, 10.0 * k) for k in range(9)], motion, OWN_HEADER).world())
        assert "train.yaml: world.motion" in text
        assert "gnss_log" in text
        assert says in text

    def test_a_mean_over_rows_is_taken_of_the_trusted_ones_alone(self, tmp_path: Path) -> None:
        rows = [own_row(0.1 * k, k if k % 2 else 9000.0, 4 if k % 2 else 1) for k in range(200)]
        motion = train_of(tmp_path, rows, RECORDED | {"gnss_log": OWN_MAP | {"average_s": 1.0}}, OWN_HEADER).world().motion
        assert motion.at(10.0)[0] == pytest.approx(100.0, abs=0.5)

    @pytest.mark.parametrize("unit_zero", ["2022-02-25T00:00:05Z", None])
    def test_a_unit_that_replays_the_log_needs_the_same_time_zero(self, tmp_path: Path, unit_zero: str | None) -> None:
        """The truth's time 0 is 5 s into the log; a unit that begins elsewhere would be 50 m off it."""
        columns = {
            "latitude_deg": {"column": "latitude_deg", "unit": "deg"},
            "longitude_deg": {"column": "longitude_deg", "unit": "deg"},
            "solution": {"column": "position_type", "values": {"*": "rtk_fixed"}},
        }
        log = {"file": "log.csv", "columns": columns}
        time = {"column": "time_utc", "unit": "iso8601"}
        truth = RECORDED | {"gnss_log": log | {"time": time | {"zero_at": "2022-02-25T00:00:05Z"}}}
        own = log | {"time": time | ({"zero_at": unit_zero} if unit_zero else {})}
        unit = {"units.gnss": {"kind": "gnss", "source": "recording", "recording": own}}
        rows = [row(k, 10.0 * k) for k in range(60)]
        if unit_zero is not None:
            assert train_of(tmp_path, rows, truth, **unit).world().motion.at(0.0)[0] == pytest.approx(50.0, abs=0.1)
            return
        text = refusal(lambda: train_of(tmp_path, rows, truth, **unit))
        assert "world.motion.gnss_log.time.zero_at: scenario time 0 is 5 s after that of units.gnss.recording" in text


class TestRowsThatAreNoTruth:
    """One line that names train file, field, recording, line and time; and no motion."""

    ROWS = tuple(row(k, 10.0 * k) for k in range(40))

    def log_refusal(self, folder: Path, rows: list[str]) -> str:
        return refusal(lambda: train_of(folder, rows, RECORDED).world())

    def test_the_same_time_at_another_position(self, tmp_path: Path) -> None:
        text = self.log_refusal(tmp_path, [*self.ROWS[:21], row(20.0, 203.0), *self.ROWS[21:]])
        assert "train.yaml: world.motion.gnss_log: " in text
        assert "log.csv: line 23 (20 s): the time of line 22 again, at another position" in text

    def test_the_same_row_twice_is_one_row(self, tmp_path: Path) -> None:
        once, twice = tmp_path / "once", tmp_path / "twice"
        once.mkdir()
        twice.mkdir()
        expected = train_of(once, self.ROWS, RECORDED).world().motion
        repeated = train_of(twice, [*self.ROWS[:21], self.ROWS[20], *self.ROWS[21:]], RECORDED).world().motion
        assert [repeated.at(t) for t in (3.0, 20.0, 30.5)] == [expected.at(t) for t in (3.0, 20.0, 30.5)]

    def test_a_time_that_goes_back(self, tmp_path: Path) -> None:
        text = self.log_refusal(tmp_path, [*self.ROWS[:20], self.ROWS[25], *self.ROWS[20:]])
        assert "log.csv: line 23 (20 s): time goes back, from 25 s in line 22" in text

    def test_rows_that_are_not_trusted_may_say_what_they_like(self, tmp_path: Path) -> None:
        rows = [*self.ROWS[:21], row(20.0, 203.0, "SINGLE"), row(3.0, 30.0, "PROPAGATED"), *self.ROWS[21:]]
        assert train_of(tmp_path, rows, RECORDED).world().motion.at(20.0)[0] == pytest.approx(200.0, abs=0.3)

    def test_a_path_that_repeats_a_time_elsewhere(self, tmp_path: Path) -> None:
        rows = path_rows([(10.0 * k, 0.0) for k in range(40)], 1.0)
        t_s, x, *rest = rows[20].split(",")
        rows.insert(21, ",".join([t_s, f"{float(x) + 3.0:.6f}", *rest]))
        assert "path.csv: line 23 (20 s): the time of line 22 again, at another position" in refusal(
            lambda: path_train(tmp_path, rows).world()
        )

    def test_a_path_that_crosses_itself(self, tmp_path: Path) -> None:
        """A figure of eight at 10 m/s, 20 rows a second, from before its crossing to after it."""
        angles = [0.3 + 6.2 * k / 2000 for k in range(2000)]
        rows = path_rows([(200.0 * math.sin(a), 200.0 * math.sin(a) * math.cos(a)) for a in angles], 0.05)
        text = refusal(lambda: path_train(tmp_path, rows).world())
        assert "train.yaml: world.motion.path_csv: " in text
        # the crossing is first reached at π, after 2.84/6.2 of the rows
        assert "path.csv: line 91" in text
        assert "(45." in text
        assert "the chainage is ambiguous: " in text

    def test_a_path_that_runs_back(self, tmp_path: Path) -> None:
        places = [(10.0 * k, 0.0) for k in range(40)]
        text = refusal(lambda: path_train(tmp_path, path_rows([*places, *reversed(places[:-1])], 1.0)).world())
        assert "path.csv: line 2 (0 s): the chainage is ambiguous" in text

    def test_a_train_that_runs_back_on_a_line_of_its_own_is_a_truth(self, tmp_path: Path) -> None:
        rows = [row(k, 10.0 * k if k < 40 else 800.0 - 10.0 * k) for k in range(80)]
        motion = train_of(tmp_path, rows, RECORDED).world().motion
        assert motion.at(60.0)[:2] == pytest.approx((200.0, -10.0), abs=0.2)

    def test_a_chainage_that_jumps_to_another_part_of_the_line(self, tmp_path: Path) -> None:
        """The line goes out and comes back 6 m beside itself; the log is 4 m off from its 20th second on."""
        points = [[4.5, 50.9], [4.6, 50.9], [4.6, 50.9 + 6.0 / LAT_M], [4.5, 50.9 + 6.0 / LAT_M]]
        rows = [row(k, 100.0 + 10.0 * k, north_m=0.0 if k < 20 else 4.0) for k in range(40)]

        def made() -> Any:
            train_of(tmp_path, rows, RECORDED)
            (tmp_path / "l.geojson").write_text(f'{{"type": "LineString", "coordinates": {points}}}', encoding="utf-8")
            return load_train(tmp_path / "train.yaml").world()

        assert "log.csv: line 22 (20 s): the chainage jumps from 290 m to 13" in refusal(made)
