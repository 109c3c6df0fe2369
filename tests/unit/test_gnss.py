"""A receiver errs as its train file says; its sound fixes count, on the part of the line that they belong to."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest

from examples import T0, all_readings, gnss_log, head, sensor
from milepost.estimation.motion import process_noise, transition
from milepost.recordings.gnss_log import read_gnss_log
from milepost.recordings.measured import Measured
from milepost.sensors.base import World
from milepost.sensors.observed import Belief
from milepost.simulation.motion import Profile, WhiteJerkMotion
from milepost.track.earth import moved
from milepost.track.line import Line
from milepost.track.track import Track
from milepost_schemas import PositionReading

GEOD = pyproj.Geod(ellps="WGS84")
DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "brussels"
NORTH_EAST = Track([(4.5 + 0.01 * i, 50.9 + 0.006 * i) for i in range(60)])


def line(*tunnels: tuple[float, float], track: Track = NORTH_EAST) -> Line:
    return Line("l", track.length_m, (), 0.0, track, tunnels=tunnels)


class Steady:
    """A train that keeps its speed."""

    def __init__(self, start_m: float, speed_mps: float, end_s: float) -> None:
        self._start_m, self._speed_mps, self.end_s = start_m, speed_mps, end_s

    def at(self, t_s: float) -> tuple[float, float, float]:
        return self._start_m + self._speed_mps * t_s, self._speed_mps, 0.0


def world(end_s: float, seed: int = 1, on: Line | None = None, speed: float = 10.0, start_m: float = 100.0) -> World:
    return World(Steady(start_m, speed, end_s), on or line(), seed)


def gnss(on: Line | None = None, **options: Any) -> Any:
    return sensor("gnss", on or line(), "gnss", **options)


def said(on: World, from_s: float = 0.0, **options: Any) -> list[Measured]:
    return all_readings(gnss(on.line, **options).source(on, from_s))


def errors(on: World, measured: list[Measured]) -> Any:
    """East and north error of each fix (n, 2), by the geodesic from the true place."""
    true = np.array([on.line.track.locate(on.motion.at(m.measured_s)[0]) for m in measured])  # type: ignore[union-attr]
    seen = np.array([(m.fields["latitude_deg"], m.fields["longitude_deg"]) for m in measured])
    azimuth, _, distance = GEOD.inv(true[:, 1], true[:, 0], seen[:, 1], seen[:, 0])
    return np.column_stack([distance * np.sin(np.radians(azimuth)), distance * np.cos(np.radians(azimuth))])


def reading(m: Measured) -> PositionReading:
    return PositionReading(**head("gnss", measured_at_ns=T0 + round(m.measured_s * 1e9)), **m.fields)


# how it errs --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("east", "north"), [(100.0, 0.0), (0.0, -100.0), (30.0, 40.0)])
def test_a_place_is_moved_by_metres_east_and_north(east: float, north: float) -> None:
    latitude, longitude = moved(50.9, 4.5, east, north)
    azimuth, _, distance = GEOD.inv(4.5, 50.9, longitude, latitude)
    assert distance == pytest.approx(math.hypot(east, north), rel=1e-5)
    assert math.radians(azimuth) == pytest.approx(math.atan2(east, north), abs=2e-5)


@pytest.mark.parametrize(("solution", "std"), [("rtk_fixed", 0.02), ("differential", 0.5), ("single", 3.0)])
def test_the_white_part_has_its_solutions_variance_and_no_memory(solution: str, std: float) -> None:
    on = world(400.0)
    told = said(on, rate_hz=10.0, position_std_m={solution: std}, simulated={"solution": solution})
    assert {m.fields["solution"] for m in told} == {solution}
    assert {m.fields["horizontal_std_m"] for m in told} == {std}
    e = errors(on, told) / std
    n = len(e)
    assert n == 4001
    assert e.std(axis=0) == pytest.approx(1.0, abs=4.0 / math.sqrt(2 * n))
    assert np.abs(e.mean(axis=0)).max() < 4.0 / math.sqrt(n)
    assert abs(np.mean(e[:, 0] * e[:, 1])) < 4.0 / math.sqrt(n)
    for lag in (1, 7):
        assert np.abs(np.mean(e[lag:] * e[:-lag], axis=0)).max() < 4.0 / math.sqrt(n)


def test_the_slow_part_has_its_variance_and_time_constant() -> None:
    """Of a Markov process of τ = 4 s, 2000 s hold T/2τ = 250 independent values on each axis: 500 in all."""
    on = world(2000.0)
    told = said(on, rate_hz=1.0, position_std_m={"rtk_fixed": 1e-6}, offset_std_m={"rtk_fixed": 2.0}, offset_time_s=4.0)
    e = errors(on, told) / 2.0
    independent = 500
    assert np.mean(e**2) == pytest.approx(1.0, abs=4.0 * math.sqrt(2.0 / independent))
    for lag_s in (1, 4, 8):
        correlation = np.mean(e[lag_s:] * e[:-lag_s])
        assert correlation == pytest.approx(math.exp(-lag_s / 4.0), abs=4.0 / math.sqrt(independent))
    assert abs(np.mean(e[40:] * e[:-40])) < 4.0 / math.sqrt(independent)


def test_multipath_comes_as_often_and_as_large_as_told() -> None:
    on = world(800.0)
    tails = {"outliers": {"probability": 0.05, "factor": 10.0}, "states": "truth"}
    told = said(on, rate_hz=10.0, position_std_m={"rtk_fixed": 1.0}, simulated=tails)
    stated = np.array([m.fields["horizontal_std_m"] for m in told])
    n = len(told)
    assert set(stated) == {1.0, 10.0}
    assert np.mean(stated == 10.0) == pytest.approx(0.05, abs=4.0 * math.sqrt(0.05 * 0.95 / n))
    e = errors(on, told)
    for std in (1.0, 10.0):
        some = e[stated == std] / std
        assert np.mean(some**2) == pytest.approx(1.0, abs=4.0 * math.sqrt(2.0 / some.size))


def test_a_wandering_standard_deviation_is_uniform_in_its_logarithm() -> None:
    """E σ² = (10² - 1²)/(2 ln 10) = 21.5 with a spread of 25 over T/2τ = 500 independent values."""
    on = world(2000.0)
    wandering = {"wandering": {"least_m": 1.0, "most_m": 10.0, "time_constant_s": 2.0}, "states": "truth"}
    told = said(on, rate_hz=2.0, position_std_m={"rtk_fixed": 1.0}, simulated=wandering)
    stated = np.array([m.fields["horizontal_std_m"] for m in told])
    assert stated.min() >= 1.0
    assert stated.max() <= 10.0
    assert np.mean(stated**2) == pytest.approx(21.5, abs=4.0 * 25.0 / math.sqrt(500))
    assert np.mean(np.log10(stated)) == pytest.approx(0.5, abs=4.0 * math.sqrt(1.0 / 12.0 / 500))
    e = errors(on, told) / stated[:, None]
    assert np.mean(e**2) == pytest.approx(1.0, abs=4.0 * math.sqrt(2.0 / e.size))
    # and it does wander, rather than jump: half a second keeps e^(-1/4) of it
    x = np.log(stated) - np.log(stated).mean()
    assert 0.6 < np.mean(x[1:] * x[:-1]) / np.mean(x * x) < 0.9


def test_a_receiver_may_state_nothing_or_its_datasheets_figure() -> None:
    for states, expected in (("nothing", {None}), ("datasheet", {1.0})):
        simulated = {"wandering": {"least_m": 1.0, "most_m": 10.0, "time_constant_s": 20.0}, "states": states}
        told = said(world(50.0), position_std_m={"rtk_fixed": 1.0}, simulated=simulated)
        assert {m.fields.get("horizontal_std_m") for m in told} == expected


def test_no_fix_in_a_tunnel_and_poorer_ones_after() -> None:
    """At 10 m/s from 100 m the tunnel from 500 to 800 m is passed between 40 and 70 s."""
    on = world(120.0, on=line((500.0, 800.0)))
    both = {"rtk_fixed": 0.02, "single": 2.0}
    told = said(on, rate_hz=1.0, position_std_m=both, simulated={"recovery_s": 10.0})
    assert [m.measured_s for m in told] == [*range(40), *range(70, 121)]
    single = [m.measured_s for m in told if m.fields["solution"] == "single"]
    assert single == list(range(70, 80))
    e = np.abs(errors(on, told)).max(axis=1)
    assert max(error for error, m in zip(e, told, strict=True) if m.fields["solution"] == "rtk_fixed") < 0.1


def test_a_train_going_back_leaves_tunnels_at_their_other_end() -> None:
    on = world(60.0, on=line((500.0, 800.0)), speed=-10.0, start_m=1000.0)
    told = said(on, rate_hz=1.0, position_std_m={"rtk_fixed": 0.02, "single": 2.0}, simulated={"recovery_s": 5.0})
    # at 50 s it stands at 500 m, in [500, 800); one second later it is out
    assert [m.measured_s for m in told] == [*range(20), 20, *range(51, 61)]
    assert [m.measured_s for m in told if m.fields["solution"] == "single"] == [51, 52, 53, 54, 55]


def test_satellites_and_dilution_are_told() -> None:
    told = said(world(2000.0), rate_hz=1.0, simulated={"satellites": 12})
    n = [m.fields["satellites"] for m in told]
    assert min(n) >= 0
    # 1.5 std with 60 s: 17 independent values
    assert np.mean(n) == pytest.approx(12.0, abs=4.0 * 1.5 / math.sqrt(17))
    assert all(m.fields["hdop"] == pytest.approx(3.0 / math.sqrt(k)) for m, k in zip(told, n, strict=True))


@pytest.mark.parametrize("from_s", [0.3, 7.0, 250.0])
def test_a_receiver_that_restarts_says_what_it_would_have_said(from_s: float) -> None:
    on = world(300.0, on=line((700.0, 900.0)))
    options: dict[str, Any] = {
        "offset_std_m": {"rtk_fixed": 1.0},
        "speed_std_mps": 0.1,
        "simulated": {
            "wandering": {"least_m": 1.0, "most_m": 10.0, "time_constant_s": 20.0},
            "outliers": {"probability": 0.05, "factor": 10.0},
        },
    }
    whole = said(on, **options)
    assert said(on, from_s, **options) == [m for m in whole if m.measured_s >= from_s]
    assert whole != said(world(300.0, seed=2, on=on.line), **options)
    for m in whole:
        reading(m)


@pytest.mark.parametrize(
    "wrong",
    [
        {"simulated": {"solution": "single"}},
        {"offset_std_m": {"single": 1.0}},
        {"simulated": {"recovery_s": 5.0}},
        {"simulated": {"solution": "rtk"}},
        {"simulated": {"wandering": {"least_m": 2.0, "most_m": 1.0, "time_constant_s": 1.0}}},
        {"simulated": {"outliers": {"probability": 1.5, "factor": 2.0}}},
        {"simulated": {"invented": 1}},
        {"position_std_m": {"rtk_fixed": 0.1, "fixed": 1.0}},
    ],
)
def test_figures_that_lack_or_cannot_be_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"missing|Input should|below|Extra|must be one of"):
        gnss(**wrong)


def test_a_simulated_receiver_needs_a_line_with_geometry() -> None:
    bare = Line("l", 1e4, ())
    with pytest.raises(ValueError, match="geometry"):
        gnss(bare).source(world(10.0, on=bare), 0.0)


# what it observes ---------------------------------------------------------------------------------------------------------


def fix(s: float = 1000.0, t_s: float = 0.0, aside_m: float = 0.0, **fields: Any) -> PositionReading:
    """A fix at a chainage, `aside_m` to the right of the track, which goes on straight beyond its ends."""
    heading, on_m = math.radians(NORTH_EAST.heading_deg(s)), min(max(s, 0.0), NORTH_EAST.length_m)
    east = (s - on_m) * math.sin(heading) + aside_m * math.cos(heading)
    north = (s - on_m) * math.cos(heading) - aside_m * math.sin(heading)
    latitude, longitude = moved(*NORTH_EAST.locate(s), east, north)
    given = {"latitude_deg": latitude, "longitude_deg": longitude, "solution": "rtk_fixed", **fields}
    return PositionReading(**head("gnss", measured_at_ns=T0 + round(t_s * 1e9)), **given)


def test_an_offset_is_a_private_state_in_its_solutions_units() -> None:
    receiver = gnss(position_std_m={"rtk_fixed": 0.1, "single": 2.0}, offset_std_m={"single": 3.0}, offset_time_s=50.0)
    (state,) = receiver.private_states
    assert (state.name, state.prior_mean, state.prior_std, state.time_constant_s) == ("offset", 0.0, 1.0, 50.0)
    assert state.noise_psd == pytest.approx(2.0 / 50.0)
    for solution, slow, variance in (("rtk_fixed", 0.0, 0.01), ("single", 3.0, 4.0)):
        ((row, value, r),) = receiver.observe(fix(solution=solution), None)
        assert row == (1.0, 0.0, 0.0, slow)
        assert value == pytest.approx(1000.0, abs=0.01)
        assert r == pytest.approx(variance)
    assert gnss().private_states == ()


def test_the_stated_standard_deviation_counts_only_where_it_is_trusted() -> None:
    stated = fix(horizontal_std_m=0.5)
    assert gnss().observe(stated, None)[0].variance == pytest.approx(0.01)
    assert gnss(trust_stated_std=True).observe(stated, None)[0].variance == pytest.approx(0.25)
    assert gnss(trust_stated_std=True).observe(fix(), None)[0].variance == pytest.approx(0.01)
    # a solution that is not listed does not count, whatever it states
    assert gnss(trust_stated_std=True).observe(fix(solution="single", horizontal_std_m=0.5), None) == ()


@pytest.mark.parametrize(("turned", "expected"), [(0.0, 20.0), (5.0, 19.924), (180.0, -20.0), (-175.0, -19.924)])
def test_speed_over_ground_counts_along_the_track_with_its_sign(turned: float, expected: float) -> None:
    receiver = gnss(speed_std_mps=0.1)
    course = (NORTH_EAST.heading_deg(1000.0) + turned) % 360.0
    _, (row, value, r) = receiver.observe(fix(speed_mps=20.0, course_deg=course), None)
    assert row == (0.0, 1.0, 0.0)
    assert value == pytest.approx(expected, abs=0.001)
    assert r == pytest.approx(0.01)
    _, speed = receiver.observe(fix(speed_mps=20.0, course_deg=course, speed_std_mps=0.3), None)
    assert speed.variance == pytest.approx(0.09)


def test_a_speed_without_a_course_counts_only_near_standstill() -> None:
    receiver = gnss(speed_std_mps=0.1)
    assert len(receiver.observe(fix(speed_mps=5.0), None)) == 1
    _, (row, value, r) = receiver.observe(fix(speed_mps=0.2), None)
    assert (row, value) == ((0.0, 1.0, 0.0), 0.0)
    assert r == pytest.approx(0.05)


def test_without_a_figure_for_it_the_speed_is_not_used() -> None:
    assert len(gnss().observe(fix(speed_mps=20.0, course_deg=NORTH_EAST.heading_deg(1000.0)), None)) == 1


@pytest.mark.parametrize("speed", [20.0, -20.0, 0.05])
def test_the_simulated_speed_comes_back_unbiased_with_its_variance(speed: float) -> None:
    on = world(400.0, speed=speed, start_m=20_000.0)
    receiver = gnss(on.line, speed_std_mps=0.2)
    seen = [receiver.observe(reading(m), None)[1].value for m in said(on, speed_std_mps=0.2)]
    n = len(seen)
    assert n == 1001
    assert np.mean(seen) == pytest.approx(speed, abs=4.0 * 0.2 / math.sqrt(n))
    assert np.std(seen) == pytest.approx(0.2, rel=4.0 / math.sqrt(2 * n))


def test_a_filter_that_knows_the_offset_is_consistent() -> None:
    """NEES of [s, v, a] at the end of 24 runs: χ² with 72 degrees of freedom over 24, between 1.7 and 4.8 at 99.9 %."""
    options: dict[str, Any] = {"position_std_m": {"rtk_fixed": 0.5}, "offset_std_m": {"rtk_fixed": 2.0}, "offset_time_s": 10.0}
    q, step = 1e-3, 0.4
    F, Q = np.eye(4), np.zeros((4, 4))
    F[:3, :3], Q[:3, :3] = transition(step), process_noise(step, q)
    F[3, 3] = math.exp(-step / 10.0)
    Q[3, 3] = 1.0 - F[3, 3] ** 2
    squares = []
    for seed in range(24):
        motion = WhiteJerkMotion(Profile([(0.0, 10.0)], 100.0), 40.0, q, None, [0.0] * 3, seed)
        on = World(motion, line(), seed)
        receiver, track = gnss(on.line, **options), on.line.track
        assert track is not None
        x, P = np.array([100.0, 10.0, 0.0, 0.0]), np.diag([1e-6, 1e-6, 1e-6, 1.0])
        told = said(on, **options)
        for k, m in enumerate(told):
            if k:
                x, P = F @ x, F @ P @ F.T + Q
            for row, value, r in receiver.observe(reading(m), None):
                h = np.array(row)
                K = P @ h / (h @ P @ h + r)
                x, P = x + K * (value - h @ x), P - np.outer(K, h @ P)
        error = np.array(motion.at(told[-1].measured_s)) - x[:3]
        squares.append(error @ np.linalg.solve(P[:3, :3], error))
    assert 1.7 < np.mean(squares) < 4.8


# which of its fixes count ------------------------------------------------------------------------------------------------


def test_an_observer_tells_once_that_trust_is_lost_and_regained() -> None:
    observer = gnss().observer()
    told, counts = [], []
    for k in range(60):
        t = 0.5 * k
        solution = "propagated" if 5.0 <= t < 12.0 else "rtk_fixed"
        counts.append(len(observer.observe(fix(1000.0 + 20.0 * t, t, solution=solution), None)))
        told += [(t, notice.code) for notice in observer.notices()]
    assert told == [(9.5, "gnss_not_trusted"), (18.0, "gnss_trusted_again")]
    assert counts == [1] * 10 + [0] * 26 + [1] * 24


def test_after_a_restart_rtk_alone_has_to_prove_itself() -> None:
    again = gnss(position_std_m={"rtk_fixed": 0.1, "single": 3.0}, source="recording").observer()
    again.restarted()
    counts = [len(again.observe(fix(s=1000.0 + 10.0 * k, t_s=0.5 * k), None)) for k in range(16)]
    assert counts == [0] * 12 + [1] * 4
    again.restarted()
    assert len(again.observe(fix(s=1200.0, t_s=10.0, solution="single"), None)) == 1


def test_poor_sky_widens_a_datasheets_figure_not_a_stated_one() -> None:
    figures = {"position_std_m": {"single": 3.0}, "source": "recording"}
    poor = fix(solution="single", satellites=6, horizontal_std_m=4.0)
    assert gnss(**figures).observe(poor, None)[0].variance == pytest.approx(36.0)
    assert gnss(**figures, trust_stated_std=True).observe(poor, None)[0].variance == pytest.approx(16.0)


@pytest.mark.parametrize(
    ("places", "code", "words"),
    [
        (lambda t: 1000.0 + 20.0 * min(t, 4.0), "gnss_not_trusted", "stands still"),
        (lambda t: 1000.0 + 20.0 * t + (50.0 if t >= 4.0 else 0.0), "gnss_not_trusted", "move as no train can"),
        (lambda t: 20.0 * t - 88.0, "gnss_off_line", "before or beyond the line"),
    ],
)
def test_an_observer_tells_once_what_is_strange_about_fixes(places: Any, code: str, words: str) -> None:
    observer, told = gnss().observer(), []
    for k in range(15):
        observer.observe(fix(places(0.4 * k), 0.4 * k), None)
        told += observer.notices()
    assert [notice.code for notice in told] == [code]
    assert words in told[0].text


def test_an_observers_memory_is_all_that_it_goes_by() -> None:
    """Set back into a proof, it continues there as it did before; its notices are its own."""
    observer = gnss().observer()
    readings = [fix(1000.0 + 10.0 * k, 0.5 * k, solution="propagated" if k < 12 else "rtk_fixed") for k in range(40)]
    memories, counts = [], []
    for r in readings:
        memories.append(observer.memory)
        counts.append(len(observer.observe(r, None)))
    assert counts == [0] * 24 + [1] * 16
    for k in (38, 20, 5, 0):
        observer.memory = memories[k]
        assert [len(observer.observe(r, None)) for r in readings[k:]] == counts[k:]


# where the line ends, and where it comes near itself ----------------------------------------------------------------------


def test_a_train_before_the_origin_is_not_observed_there() -> None:
    """30 m before it an RTK fix is outside; within its noise of the end it counts as what it is, below zero."""
    assert gnss().observe(fix(-30.0), None) == ()
    assert gnss().observe(fix(NORTH_EAST.length_m + 30.0), None) == ()
    (near,) = gnss().observe(fix(-0.3), None)
    assert near.value == pytest.approx(-0.3, abs=0.01)


def test_fixes_of_a_train_at_the_lines_end_are_unbiased() -> None:
    """Half of them lie beyond it."""
    on = world(800.0, speed=0.0, start_m=0.0)
    seen = [receiver.observe(reading(m), None)[0].value for receiver in (gnss(on.line),) for m in said(on)]
    assert len(seen) == 2001
    assert np.mean(seen) == pytest.approx(0.0, abs=4.0 * 0.1 / math.sqrt(2001))
    assert np.std(seen) == pytest.approx(0.1, rel=4.0 / math.sqrt(2 * 2001))


def around(legs: list[tuple[float, float]]) -> Track:
    """A track of legs (azimuth_deg, length_m)."""
    points = [(4.5, 50.9)]
    for azimuth, length in legs:
        points.append(GEOD.fwd(*points[-1], azimuth, length)[:2])
    return Track(points)


# out 560 m, 8 m to the left, and back: at 500 m out the way back is at 628 m, at 10 m out at 1118 m
HAIRPIN = around([(90.0, 560.0), (0.0, 8.0), (270.0, 560.0)])


def beside(out_m: float, left_m: float, t_s: float = 0.0, solution: str = "rtk_fixed") -> PositionReading:
    """A fix beside the way out of the hairpin, by metres to its left."""
    latitude, longitude = moved(*HAIRPIN.locate(out_m), 0.0, left_m)
    return PositionReading(
        **head("gnss", measured_at_ns=T0 + round(t_s * 1e9)), latitude_deg=latitude, longitude_deg=longitude, solution=solution
    )


def belief(position_m: float, std_m: float) -> Belief:
    return Belief(np.array([position_m, 20.0, 0.0]), np.diag([std_m**2, 1.0, 0.1]))


@pytest.mark.parametrize("left_m", [0.0, 3.0, 5.0, 8.0])
@pytest.mark.parametrize(("position_m", "there"), [(10.0, 10.0), (1118.0, 1118.0), (30.0, 10.0), (1100.0, 1118.0)])
def test_the_belief_decides_on_which_leg_a_fix_lies(position_m: float, there: float, left_m: float) -> None:
    """1.1 km apart along the line and 8 m across, whichever is nearer; the row is the same."""
    (seen,) = gnss(line(track=HAIRPIN)).observe(beside(10.0, left_m), belief(position_m, 3.0))
    assert seen.value == pytest.approx(there, abs=0.1)
    assert seen.row == (1.0, 0.0, 0.0)


def test_a_fix_that_both_legs_explain_is_ambiguous() -> None:
    """6 × 100 m reach both; without a belief nothing says which; at the turn they are one."""
    receiver = gnss(line(track=HAIRPIN))
    assert receiver.observe(beside(300.0, 3.0), belief(560.0, 100.0)) == ()
    assert receiver.observe(beside(300.0, 3.0), None) == ()
    assert len(receiver.observe(beside(300.0, 3.0), belief(300.0, 40.0))) == 1
    assert len(receiver.observe(beside(555.0, 3.0), None)) == 1
    observer = receiver.observer()
    for k in range(3):
        observer.observe(beside(300.0 + k, 3.0, 0.4 * k), None)
    assert [notice.code for notice in observer.notices()] == ["gnss_ambiguous"]


def test_a_stray_fix_is_not_given_to_another_leg() -> None:
    """11 m to the left of the way out it is 3 m beside the way back, 1.1 km away: it is a fix of neither."""
    assert gnss(line(track=HAIRPIN)).observe(beside(10.0, 11.0), belief(10.0, 3.0)) == ()
    assert len(gnss(line(track=HAIRPIN)).observe(beside(10.0, 11.0), belief(1118.0, 3.0))) == 1


def test_a_train_round_a_hairpin_is_followed_on_both_legs() -> None:
    """At 20 m/s out and back, with fixes 4.5 m towards the other leg, which is nearer to them; the turn has none."""
    observer = gnss(line(track=HAIRPIN), position_std_m={"rtk_fixed": 1.0}).observer()
    for k in range(120):
        s = 20.0 + 8.0 * k
        if 540.0 < s < 590.0:
            continue
        latitude, longitude = moved(*HAIRPIN.locate(s), 0.0, 4.5 if s < 560.0 else -4.5)
        place = {"latitude_deg": latitude, "longitude_deg": longitude, "solution": "rtk_fixed"}
        r = PositionReading(**head("gnss", measured_at_ns=T0 + round(0.4 * k * 1e9)), **place)
        (seen,) = observer.observe(r, belief(s + 3.0, 2.0))
        assert seen.value == pytest.approx(s, abs=0.1)


@pytest.mark.parametrize(
    ("legs", "needed"),
    [
        ([(90.0, 560.0), (0.0, 8.0), (270.0, 560.0)], True),
        ([(90.0, 560.0), (0.0, 19.0), (270.0, 560.0)], True),
        ([(90.0, 560.0), (0.0, 30.0), (270.0, 560.0)], False),
        ([(90.0, 560.0), (80.0, 560.0)], False),
    ],
)
def test_only_a_line_near_itself_needs_the_belief(legs: list[tuple[float, float]], needed: bool) -> None:
    """Within two limits of 10 m: a fix accepted on one leg may then lie nearer to the other."""
    assert gnss(line(track=around(legs))).needs_belief is needed


# real trains --------------------------------------------------------------------------------------------------------------


@pytest.mark.skipif(not DATA.is_dir(), reason="the recorded logs are not here")
@pytest.mark.parametrize(
    ("log", "least", "good"),
    [
        ("28876", 1098, [(0.0, 453.0)]),
        ("28554", 257, [(0.3, 113.0)]),
        ("28573", 306, [(0.3, 110.0), (577.0, 616.0)]),
        ("31259", 479, [(0.0, 279.0), (300.0, 427.0), (440.0, 476.0)]),
    ],
)
def test_on_real_trains_sound_fixes_count_and_false_not(log: str, least: int, good: list[tuple[float, float]]) -> None:
    """`good`: where RTK holds for long and lies on the track; between them the receiver coasts and RTK comes in bursts.

    28554 and 28573 begin before the line does; in 31259 RTK lies 6 to 9 m beside the track from 427.6 to 435.2 s.
    """
    geometry = json.loads((DATA / f"log_{log}_line.geojson").read_text())
    track = Track([(p[0], p[1]) for p in geometry.get("geometry", geometry)["coordinates"]])
    observer = gnss(line(track=track)).observer()
    counted = []
    for f in read_gnss_log(gnss_log(DATA / f"log_{log}_gnss.csv")):
        place = {"latitude_deg": f.latitude_deg, "longitude_deg": f.longitude_deg, "solution": f.solution}
        message = PositionReading(**head("gnss", measured_at_ns=T0 + round(f.t_s * 1e9)), **place)
        if observer.observe(message, None):
            counted.append(f.t_s)
    assert len(counted) >= least
    assert all(any(a <= t <= b for a, b in good) for t in counted)
    assert all(a < b for a, b in itertools.pairwise(counted))
