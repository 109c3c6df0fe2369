"""The track's chainage against independent geodesics, and there and back again."""

from __future__ import annotations

import math

import numpy as np
import pyproj
import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from milepost.track.line import Balise, Line
from milepost.track.track import Track

GEOD = pyproj.Geod(ellps="WGS84")
Point = tuple[float, float]


def walk(start: Point, legs: list[tuple[float, float]]) -> list[Point]:
    """Points reached from a start by (azimuth_deg, length_m) legs along geodesics."""
    points = [start]
    for azimuth, length in legs:
        lon, lat, _ = GEOD.fwd(*points[-1], azimuth, length)
        points.append((lon, lat))
    return points


starts = st.tuples(st.floats(-179.0, 179.0), st.floats(-65.0, 65.0))


@st.composite
def tracks(draw: st.DrawFn, longest_m: float = 300.0) -> tuple[list[Point], list[float]]:
    """A gently winding line and the lengths of its legs."""
    azimuth = draw(st.floats(-180.0, 180.0))
    legs = []
    for _ in range(draw(st.integers(1, 12))):
        azimuth += draw(st.floats(-8.0, 8.0))
        legs.append((azimuth, draw(st.floats(5.0, longest_m))))
    return walk(draw(starts), legs), [length for _, length in legs]


@settings(max_examples=30)
@given(track=tracks(2000.0))
def test_chainage_is_the_length_of_the_geodesics(track: tuple[list[Point], list[float]]) -> None:
    points, lengths = track
    assert Track(points).length_m == pytest.approx(sum(lengths), abs=1e-5)


@settings(max_examples=30)
@given(track=tracks(2000.0))
def test_every_vertex_has_the_chainage_of_the_legs_before_it(track: tuple[list[Point], list[float]]) -> None:
    points, lengths = track
    line = Track(points)
    for (lon, lat), chainage in zip(points, np.cumsum([0.0, *lengths]), strict=True):
        seen = line.project(lat, lon)
        assert seen.position_m == pytest.approx(chainage, abs=1e-3)
        assert abs(seen.cross_track_m) < 1e-3
        assert line.locate(float(chainage)) == pytest.approx((lat, lon), abs=1e-8)


@pytest.mark.slow
@settings(max_examples=80)
@given(track=tracks(), part=st.floats(0.0, 1.0))
def test_projecting_a_located_chainage_gives_it_back(track: tuple[list[Point], list[float]], part: float) -> None:
    line = Track(track[0])
    position = part * line.length_m
    seen = line.project(*line.locate(position))
    assert seen.position_m == pytest.approx(position, abs=1e-3)
    assert abs(seen.cross_track_m) < 0.01


def test_long_legs_give_a_located_chainage_back_too() -> None:
    line = Track(walk((4.5, 50.9), [(45.0, 900.0), (50.0, 5000.0)]))
    for position in np.linspace(0.0, line.length_m, 50):
        assert line.project(*line.locate(float(position))).position_m == pytest.approx(position, abs=1e-3)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("offset_m", [0.5, 5.0, 50.0])
def test_a_projection_has_the_nearest_points_chainage_and_distance(side: float, offset_m: float) -> None:
    line = Track(walk((4.5, 50.9), [(70.0, 250.0)] * 8))
    for leg in range(8):
        foot_lon, foot_lat, _ = GEOD.fwd(*walk((4.5, 50.9), [(70.0, 250.0)] * leg)[-1], 70.0, 100.0)
        lon, lat, _ = GEOD.fwd(foot_lon, foot_lat, 70.0 + 90.0 * side, offset_m)
        seen = line.project(lat, lon)
        assert seen.position_m == pytest.approx(250.0 * leg + 100.0, abs=0.005)
        assert seen.cross_track_m == pytest.approx(side * offset_m, abs=0.001)


def test_the_planes_scale_does_not_enter_far_from_the_middle() -> None:
    """A transverse Mercator plane is 0.3 % too long 500 km from its middle."""
    points = walk((0.0, 45.0), [(90.0, 1000.0)] * 400)
    line = Track(points)
    for leg in (0, 1, 199, 398, 399):
        lon, lat, _ = GEOD.fwd(*points[leg], GEOD.inv(*points[leg], *points[leg + 1])[0], 500.0)
        assert line.project(lat, lon).position_m == pytest.approx(1000.0 * leg + 500.0, abs=0.02)


def test_a_chainage_beyond_an_end_is_located_at_the_end() -> None:
    points = walk((4.5, 50.9), [(90.0, 100.0), (90.0, 100.0)])
    line = Track(points)
    assert line.locate(-5.0) == pytest.approx(points[0][::-1])
    assert line.locate(1e6) == pytest.approx(points[-1][::-1])


def test_points_beyond_the_ends_are_seen_beyond_them() -> None:
    """The track goes on straight: 30 m before it and 4 m to the left, 40 m after it and 3 m to the right."""
    points = walk((4.5, 50.9), [(90.0, 100.0), (120.0, 100.0)])
    line = Track(points)
    lon, lat = walk(points[0], [(270.0, 30.0), (0.0, 4.0)])[-1]
    before = line.project(lat, lon)
    assert before.position_m == pytest.approx(-30.0, abs=0.01)
    assert before.cross_track_m == pytest.approx(-4.0, abs=0.01)
    lon, lat = walk(points[-1], [(120.0, 40.0), (210.0, 3.0)])[-1]
    after = line.project(lat, lon)
    assert after.position_m == pytest.approx(240.0, abs=0.01)
    assert after.cross_track_m == pytest.approx(3.0, abs=0.01)


def test_points_beside_the_line_do_not_project_on_an_extension() -> None:
    """The line comes back across its own beginning's extension: a point there is on the line."""
    points = walk((4.5, 50.9), [(90.0, 100.0), (0.0, 60.0), (270.0, 160.0), (180.0, 200.0)])
    seen = Track(points).project(*walk(points[3], [(180.0, 60.0)])[-1][::-1])
    assert seen.position_m == pytest.approx(380.0, abs=0.01)
    assert abs(seen.cross_track_m) < 0.01


# out and back, 8 m apart: 500 m east, 8 m north, 500 m west
HAIRPIN = walk((4.5, 50.9), [(90.0, 250.0), (90.0, 250.0), (0.0, 8.0), (270.0, 250.0), (270.0, 250.0)])


def test_each_part_that_passes_a_point_is_a_leg() -> None:
    """100 m out and 3 m to the left: 5 m to the left of the way back, at 500 + 8 + 400 m."""
    line = Track(HAIRPIN)
    lon, lat = walk(HAIRPIN[0], [(90.0, 100.0), (0.0, 3.0)])[-1]
    out, back = line.legs(lat, lon, 20.0, 60.0)
    assert (out.position_m, out.cross_track_m) == pytest.approx((100.0, -3.0), abs=0.01)
    assert (back.position_m, back.cross_track_m) == pytest.approx((908.0, -5.0), abs=0.05)
    assert out == line.project(lat, lon)
    assert line.legs(lat, lon, 4.0, 60.0) == [out]
    # at the turn the two ways are one
    lon, lat = walk(HAIRPIN[2], [(270.0, 20.0), (0.0, 3.0)])[-1]
    assert len(line.legs(lat, lon, 20.0, 60.0)) == 1


def test_no_leg_passes_a_point_far_away() -> None:
    assert Track(HAIRPIN).legs(51.0, 4.5, 20.0, 60.0) == []
    assert Track([(4.5, 50.9), (4.6, 50.9)]).legs(0.0, 94.55, 20.0, 60.0) == []


@pytest.mark.parametrize(
    ("points", "near"),
    [
        (HAIRPIN, True),
        # it crosses itself
        (walk((4.5, 50.9), [(90.0, 500.0), (0.0, 200.0), (270.0, 200.0), (180.0, 400.0)]), True),
        # out and back 60 m apart
        (walk((4.5, 50.9), [(90.0, 500.0), (0.0, 60.0), (270.0, 500.0)]), False),
        # a half circle of 30 m radius, as tight as a tramway's
        (walk((4.5, 50.9), [(90.0, 300.0), *((90.0 - 10.0 * k, 5.2) for k in range(19)), (270.0, 300.0)]), False),
        (walk((4.5, 50.9), [(45.0, 900.0), (50.0, 5000.0)]), False),
        (walk((4.5, 50.9), [(45.0, 7.0)]), False),
    ],
)
def test_a_line_knows_whether_it_comes_near_itself(points: list[Point], near: bool) -> None:
    assert Track(points).comes_near_itself(20.0, 60.0) is near


@pytest.mark.slow
@settings(max_examples=60)
@given(
    turns=st.lists(st.floats(-40.0, 110.0), min_size=5, max_size=12), leg_m=st.floats(15.0, 60.0), within=st.floats(5.0, 30.0)
)
def test_comes_near_itself_agrees_with_a_comparison_of_all_pairs(turns: list[float], leg_m: float, within: float) -> None:
    """By all pairs of points 1 m apart; between `within` and 1.25 of it both answers are right."""
    line = Track(walk((4.5, 50.9), [(azimuth, leg_m) for azimuth in np.cumsum(turns)]))
    along = np.linspace(0.0, line.length_m, int(line.length_m) + 2)
    lat, lon = np.array([line.locate(float(s)) for s in along]).T
    x, y = np.cos(np.radians(lat.mean())) * np.radians(lon) * 6.37e6, np.radians(lat) * 6.37e6
    far = np.abs(along[:, None] - along) > 3.0 * within
    distance = np.hypot(x[:, None] - x, y[:, None] - y)[far]
    nearest = distance.min() if distance.size else math.inf
    said = line.comes_near_itself(within, 3.0 * within)
    event(f"near: {said}")
    if nearest < 0.98 * within:
        assert said
    elif nearest > 1.3 * within:
        assert not said


def test_turning_is_the_sum_of_the_kinks_in_between() -> None:
    """Kinks of 10° to the left at 100 m and of 20° to the right at 200 m: 2 tan(θ/2) each, whatever the side."""
    line = Track(walk((4.5, 50.9), [(90.0, 100.0), (80.0, 100.0), (100.0, 100.0)]))
    ten, twenty = (2.0 * math.tan(math.radians(0.5 * angle)) for angle in (10.0, 20.0))
    for begin, end, expected in ((0.0, 99.0, 0.0), (99.0, 101.0, ten), (150.0, 250.0, twenty), (-9.0, 400.0, ten + twenty)):
        assert line.turning(begin, end) == pytest.approx(expected, abs=1e-4)
        assert line.turning(end, begin) == line.turning(begin, end)


@pytest.mark.parametrize("points", [[], [(4.5, 50.9)], [(4.5, 50.9), (4.5, 50.9)], [(4.5, 50.9), (4.6, 50.9), (4.6, 50.9)]])
def test_fewer_than_two_distinct_points_are_no_track(points: list[Point]) -> None:
    with pytest.raises(ValueError, match="points"):
        Track(points)


def line_of(content: dict[str, object]) -> Line:
    return Line("l", 10.0, (Balise("b1", 1.0, 0.1),), content=content)


def test_the_hash_is_a_function_of_the_content_alone() -> None:
    content = {"line": "l", "balises": [["b1", 1.0]], "length_m": 10.0}
    shuffled = dict(reversed(content.items()))
    assert line_of(content).content_hash == line_of(shuffled).content_hash
    assert len(line_of(content).content_hash) == 16
    int(line_of(content).content_hash, 16)


def test_the_hash_changes_with_the_last_digit_of_the_content() -> None:
    content = {"line": "l", "balises": [["b1", 1.0]], "length_m": 10.0}
    others: list[dict[str, object]] = [
        {**content, "length_m": math.nextafter(10.0, 11.0)},
        {**content, "balises": [["b1", math.nextafter(1.0, 2.0)]]},
        {**content, "balises": [["b2", 1.0]]},
        {**content, "line": "m"},
        {**content, "points": None},
    ]
    assert len({line_of(content).content_hash, *(line_of(other).content_hash for other in others)}) == 6


def arc(start: Point, radius_m: float, side: float, step_m: float, count: int) -> list[Point]:
    """Points on a circle, `side` +1 to the right, that leaves the start northwards: chords of equal length."""
    turn = math.degrees(2.0 * math.asin(step_m / (2.0 * radius_m)))
    return walk(start, [(side * turn * (i + 0.5), step_m) for i in range(count)])


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("radius_m", "step_m"), [(800.0, 17.0), (1500.0, 25.0), (300.0, 4.0)])
def test_a_circle_turns_by_its_length_over_its_radius(side: float, radius_m: float, step_m: float) -> None:
    """Positive to the right. A geodesic's own turning against north (tan φ sin ψ / 6371 km) is far below the tolerance."""
    line = Track(arc((4.5, 0.3), radius_m, side, step_m, 60))
    for part in (0.2, 0.5, 0.77):
        position = part * line.length_m
        assert line.curvature(position) == pytest.approx(side / radius_m, rel=2e-3)
        expected = side * math.degrees(position / radius_m) % 360.0
        assert line.heading_deg(position) == pytest.approx(expected, abs=0.02)


def test_a_heading_passes_through_north_without_a_jump_in_curvature() -> None:
    line = Track(walk((4.5, 50.9), [(-10.0 + i, 20.0) for i in range(20)]))
    curvature = [line.curvature(float(s)) for s in range(50, 350, 10)]
    assert curvature == pytest.approx([math.radians(1.0) / 20.0] * len(curvature), rel=0.01)
    headings = [line.heading_deg(10.0 + 20.0 * i) for i in range(2, 18)]
    assert headings == pytest.approx([(-10.0 + i) % 360.0 for i in range(2, 18)], abs=0.02)


def test_a_very_short_track_has_a_heading_and_no_curvature() -> None:
    line = Track(walk((4.5, 50.9), [(123.0, 4.0), (123.0, 5.0)]))
    for position in (-5.0, 0.0, 4.5, 9.0, 20.0):
        assert line.heading_deg(position) == pytest.approx(123.0, abs=1e-3)
        assert line.curvature(position) == pytest.approx(0.0, abs=1e-7)
