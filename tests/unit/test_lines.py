"""Line files: gradient, tunnels, recorded paths, and the lines that come with Milepost."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
import yaml

from milepost.config.line_file import load_line
from milepost.config.yaml_files import ConfigError

LINES = Path(__file__).parents[2] / "deploy" / "lines"
COMMA = Path(__file__).parents[3] / "shared" / "data" / "comma2k19" / "truth.csv"
PLAIN: dict[str, Any] = {"line": "l", "length_m": 5000.0}


def write(folder: Path, content: dict[str, Any]) -> Path:
    path = folder / "line.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_a_slope_is_linear_between_its_rows_and_held_beyond_them(tmp_path: Path) -> None:
    line = load_line(write(tmp_path, {**PLAIN, "gradient": [[1000.0, 10.0], [2000, -30], [3000.0, -30.0]]}))
    assert [line.slope_at(s) for s in (0.0, 1000.0, 1250.0, 1500.0, 2000.0, 2999.0, 4500.0)] == pytest.approx(
        [0.010, 0.010, 0.0, -0.010, -0.030, -0.030, -0.030]
    )
    assert load_line(write(tmp_path, PLAIN)).slope_at(1234.0) == 0.0


def test_a_tunnel_begins_with_its_first_metre_and_ends_before_its_last(tmp_path: Path) -> None:
    line = load_line(write(tmp_path, {**PLAIN, "tunnels": [[100.0, 200.0], [200.0, 250.0], [400.0, 500.0]]}))
    inside = {99.9: False, 100.0: True, 199.9: True, 200.0: True, 250.0: False, 399.0: False, 450.0: True, 500.0: False}
    assert {s: line.in_tunnel(s) for s in inside} == inside
    assert not load_line(write(tmp_path, PLAIN)).in_tunnel(150.0)


def test_stations_are_in_order_and_for_people_alone(tmp_path: Path) -> None:
    """GIVEN the same line with stations, THEN they are in order, and the hash by which maps are compared is the same."""
    stations = [{"name": "Gare du Midi", "position_m": 4800.0}, {"name": "Nord", "position_m": 0.0}]
    line = load_line(write(tmp_path, {**PLAIN, "stations": stations}))
    assert line.stations == (("Nord", 0.0), ("Gare du Midi", 4800.0))
    assert line.content_hash == load_line(write(tmp_path, PLAIN)).content_hash


@pytest.mark.parametrize(
    ("change", "field", "says"),
    [
        ({"stations": [{"name": "A", "position_m": 5000.1}]}, "stations.0.position_m", "beyond"),
        ({"stations": [{"name": " ", "position_m": 1.0}]}, "stations.0.name", "at least 1"),
        ({"stations": [{"position_m": 1.0}]}, "stations.0.name", "required"),
        ({"gradient": [[100.0, 1.0], [100.0, 2.0]]}, "gradient.1", "increase"),
        ({"gradient": [[100.0, 1.0], [5000.1, 2.0]]}, "gradient.1", "beyond"),
        ({"gradient": [[100.0, 100.0]]}, "gradient.0", "within ±100 permille"),
        ({"gradient": [[100.0, -100.0]]}, "gradient.0", "within ±100 permille"),
        ({"gradient": [[-1.0, 1.0]]}, "gradient.0", "below 0"),
        ({"gradient": [[100.0]]}, "gradient.0", "at least 2"),
        ({"tunnels": [[200.0, 100.0]]}, "tunnels.0", "after it begins"),
        ({"tunnels": [[100.0, 300.0], [200.0, 400.0]]}, "tunnels.1", "begins before"),
        ({"tunnels": [[-1.0, 300.0]]}, "tunnels.0", "begins before"),
        ({"tunnels": [[100.0, 5001.0]]}, "tunnels.0", "beyond"),
        ({"geojson": "a.geojson", "path_csv": "b.csv"}, "path_csv", "beside geojson"),
        ({"path_csv": "no.csv"}, "path_csv", "No such file"),
        ({"path_csv": "bad.csv"}, "path_csv", "ecef_y_m: missing"),
        ({"path_csv": "text.csv"}, "path_csv", "line 3"),
        ({"path_csv": "moon.csv"}, "path_csv", "no place on the earth"),
        ({"path_csv": "still.csv"}, "path_csv", "two points"),
        ({"path_csv": "empty.csv"}, "path_csv", "two points"),
    ],
)
def test_a_mistake_in_a_profile_or_path_names_the_field(tmp_path: Path, change: dict[str, Any], field: str, says: str) -> None:
    head = "ecef_x_m,ecef_y_m,ecef_z_m\n"
    (tmp_path / "bad.csv").write_text("ecef_x_m,ecef_z_m\n6378137,0\n")
    (tmp_path / "text.csv").write_text(head + "6378137,0,0\n6378137,0,x\n")
    (tmp_path / "moon.csv").write_text(head + "384400000,0,0\n")
    (tmp_path / "still.csv").write_text(head + "6378137,0,0\n6378137,0.9,0\n")
    (tmp_path / "empty.csv").write_text(head)
    with pytest.raises(ConfigError) as raised:
        load_line(write(tmp_path, {**PLAIN, **change}))
    assert f"line.yaml: {field}: " in str(raised.value)
    assert says in str(raised.value)


def test_a_profile_is_part_of_the_hash_only_where_it_is_given(tmp_path: Path) -> None:
    plain = load_line(write(tmp_path, PLAIN))
    assert sorted(plain.content) == ["balises", "length_m", "line", "map_accuracy_m", "points"]
    others = [{"gradient": [[0.0, 1.0]]}, {"gradient": [[0.0, 2.0]]}, {"tunnels": [[0.0, 1.0]]}]
    hashes = [load_line(write(tmp_path, {**PLAIN, **other})).content_hash for other in others]
    assert len({plain.content_hash, *hashes}) == 4


def test_a_recorded_path_is_a_line_of_its_arc_length(tmp_path: Path) -> None:
    """Along the equator of WGS84 an angle φ is 6378137 φ metres; points 0.3 m apart are thinned to at least 1 m."""
    angles = np.arange(0.0, 300.0, 0.3) / 6378137.0
    rows = [f"{6378137.0 * math.cos(a)},{6378137.0 * math.sin(a)},0.0" for a in angles]
    (tmp_path / "path.csv").write_text("\n".join(["ecef_x_m,ecef_y_m,ecef_z_m", *rows]))
    line = load_line(write(tmp_path, {"line": "l", "path_csv": "path.csv"}))
    assert line.track is not None
    assert line.length_m == pytest.approx(249 * 1.2, abs=1e-3)
    assert len(line.content["points"]) == 250
    assert line.track.heading_deg(100.0) == pytest.approx(90.0, abs=1e-4)


@pytest.mark.skipif(not COMMA.exists(), reason="the recording comma2k19 is not here")
def test_the_recorded_car_went_1011_m(tmp_path: Path) -> None:
    """1011.4 m by the sum of its recorded speeds over its 60 s; chainage is the horizontal part."""
    times, *velocity = np.loadtxt(COMMA, delimiter=",", skiprows=1, usecols=(0, 4, 5, 6)).T
    travelled = float(np.trapezoid(np.sqrt(sum(v * v for v in velocity)), times))
    line = load_line(write(tmp_path, {"line": "car", "path_csv": str(COMMA)}))
    assert line.length_m == pytest.approx(travelled, abs=1.0)


def test_the_airport_line_is_as_long_as_source_c_and_follows_its_curves() -> None:
    line = load_line(LINES / "airport-maglev.yaml")
    assert line.length_m == pytest.approx(18550.0, abs=0.01)
    assert line.track is not None
    points = np.array(line.content["points"])
    _, _, spacing = pyproj.Geod(ellps="WGS84").inv(*points[:-1].T, *points[1:].T)
    assert float(np.min(spacing[:-1])) > 10.0
    assert float(np.max(spacing)) < 25.01
    s = np.arange(0.0, line.length_m, 10.0)
    curvature = np.array([line.track.curvature(float(x)) for x in s])
    assert float(np.max(np.abs(curvature))) <= 1.0 / 799.0
    # transitions of 150 m and more to 800 m: a train at 100 km/h feels less jerk than 0.2 m/s³
    assert float(np.max(np.abs(np.diff(curvature)))) / 10.0 <= 1.1 / (150.0 * 800.0)
    # how far an arc lies off its chord: c²/8R
    at = np.concatenate([[0.0], np.cumsum(spacing)])
    middle = np.interp(0.5 * (at[1:] + at[:-1]), s, np.abs(curvature))
    assert float(np.max(np.square(spacing) * middle / 8.0)) < 0.05
    heading = [line.track.heading_deg(float(x)) for x in s]
    assert max(heading) - min(heading) > 160.0
    assert float(np.sum(np.abs(np.diff(heading)))) > 400.0
    assert [to - from_ for from_, to in line.tunnels] == [400.0, 900.0]
    assert max(abs(line.slope_at(float(x))) for x in s) == pytest.approx(0.020)
    assert [b.position_m for b in line.balises] == [1000.0 * (i + 1) for i in range(18)]


def test_the_metro_line_is_level_at_its_ends_and_has_a_balise_every_kilometre() -> None:
    line = load_line(LINES / "metro.yaml")
    assert (line.length_m, line.track, len(line.balises)) == (12000.0, None, 12)
    assert line.slope_at(0.0) == line.slope_at(12000.0) == 0.0
    assert {b.location_accuracy_m for b in line.balises} == {0.05}
