"""A receiver errs on the plane as its file says, and only the fixes that deserve it count."""

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
from milepost.sensors.gnss.fix_monitor import FixLimits, FixMonitor, SeenFix
from milepost.sensors.gnss.simulated import moved
from milepost.simulation.motion import Profile, WhiteJerkMotion
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
def test_the_white_part_has_its_solutions_variance_on_each_axis_and_no_memory(solution: str, std: float) -> None:
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


def test_the_slow_part_has_its_variance_and_forgets_with_its_time_constant() -> None:
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


def test_multipath_comes_as_often_and_as_large_as_told_and_the_truth_may_be_stated() -> None:
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


def test_a_wandering_standard_deviation_is_uniform_in_its_logarithm_and_the_fixes_err_by_it() -> None:
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


def test_a_receiver_may_state_nothing_or_its_datasheets_figure_whatever_is_true() -> None:
    for states, expected in (("nothing", {None}), ("datasheet", {1.0})):
        simulated = {"wandering": {"least_m": 1.0, "most_m": 10.0, "time_constant_s": 20.0}, "states": states}
        told = said(world(50.0), position_std_m={"rtk_fixed": 1.0}, simulated=simulated)
        assert {m.fields.get("horizontal_std_m") for m in told} == expected


def test_there_is_no_fix_in_a_tunnel_and_a_poorer_one_for_a_while_after() -> None:
    """At 10 m/s from 100 m the tunnel from 500 to 800 m is passed between 40 and 70 s."""
    on = world(120.0, on=line((500.0, 800.0)))
    both = {"rtk_fixed": 0.02, "single": 2.0}
    told = said(on, rate_hz=1.0, position_std_m=both, simulated={"recovery_s": 10.0})
    assert [m.measured_s for m in told] == [*range(40), *range(70, 121)]
    single = [m.measured_s for m in told if m.fields["solution"] == "single"]
    assert single == list(range(70, 80))
    e = np.abs(errors(on, told)).max(axis=1)
    assert max(error for error, m in zip(e, told, strict=True) if m.fields["solution"] == "rtk_fixed") < 0.1


def test_a_train_that_goes_back_leaves_a_tunnel_at_its_other_end() -> None:
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
    """A fix at a chainage, `aside_m` to the right of the track."""
    heading = math.radians(NORTH_EAST.heading_deg(s))
    latitude, longitude = moved(*NORTH_EAST.locate(s), aside_m * math.cos(heading), -aside_m * math.sin(heading))
    given = {"latitude_deg": latitude, "longitude_deg": longitude, "solution": "rtk_fixed", **fields}
    return PositionReading(**head("gnss", measured_at_ns=T0 + round(t_s * 1e9)), **given)


def test_an_offset_is_a_private_state_in_units_of_its_solutions_figure() -> None:
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
def test_speed_over_ground_is_taken_along_the_track_with_its_sign(turned: float, expected: float) -> None:
    receiver = gnss(speed_std_mps=0.1)
    course = (NORTH_EAST.heading_deg(1000.0) + turned) % 360.0
    _, (row, value, r) = receiver.observe(fix(speed_mps=20.0, course_deg=course), None)
    assert row == (0.0, 1.0, 0.0)
    assert value == pytest.approx(expected, abs=0.001)
    assert r == pytest.approx(0.01)
    _, speed = receiver.observe(fix(speed_mps=20.0, course_deg=course, speed_std_mps=0.3), None)
    assert speed.variance == pytest.approx(0.09)


def test_a_speed_without_a_course_has_no_sign_and_counts_only_near_standstill() -> None:
    receiver = gnss(speed_std_mps=0.1)
    assert len(receiver.observe(fix(speed_mps=5.0), None)) == 1
    _, (row, value, r) = receiver.observe(fix(speed_mps=0.2), None)
    assert (row, value) == ((0.0, 1.0, 0.0), 0.0)
    assert r == pytest.approx(0.05)


def test_without_a_figure_for_it_the_speed_is_not_used() -> None:
    assert len(gnss().observe(fix(speed_mps=20.0, course_deg=NORTH_EAST.heading_deg(1000.0)), None)) == 1


@pytest.mark.parametrize("speed", [20.0, -20.0, 0.05])
def test_the_simulated_speed_comes_back_along_the_track_unbiased_and_with_its_variance(speed: float) -> None:
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


# which fixes count --------------------------------------------------------------------------------------------------------

KNOWN = {"rtk_fixed": 0.1, "single": 3.0}


def judged(*fixes: SeenFix, **limits: Any) -> list[str | None]:
    monitor = FixMonitor(FixLimits(**limits), KNOWN)
    return [monitor.judge(f).refused for f in fixes]


def run(
    from_s: float, to_s: float, solution: str = "rtk_fixed", off_m: float = 0.0, cross_m: float = 1.0, **more: Any
) -> list[SeenFix]:
    """Fixes every half second of a train at 20 m/s."""
    count = round((to_s - from_s) / 0.5)
    times = [from_s + 0.5 * k for k in range(count)]
    return [SeenFix(t, solution, 20.0 * t + off_m, cross_m, KNOWN.get(solution, 0.1), **more) for t in times]


def test_sound_fixes_count_from_the_first() -> None:
    assert set(judged(*run(0.0, 10.0))) == {None}


def test_short_coasting_costs_nothing_and_long_coasting_the_credit() -> None:
    short = judged(*run(0.0, 5.0), *run(5.0, 9.5, "propagated"), *run(9.5, 12.0))
    assert short == [None] * 10 + ["solution"] * 9 + [None] * 5
    long = judged(*run(0.0, 5.0), *run(5.0, 11.0, "propagated"), *run(11.0, 20.0))
    # sound for 6 s at a stretch: from 11.0 to 17.0
    assert long == [None] * 10 + ["solution"] * 12 + ["unproven"] * 12 + [None] * 6


def test_bursts_of_what_calls_itself_rtk_prove_nothing_however_many() -> None:
    bursts = [f for k in range(20) for f in (*run(20.0 + 6 * k, 22.0 + 6 * k, "propagated"), *run(22.0 + 6 * k, 26.0 + 6 * k))]
    assert None not in judged(*run(10.0, 20.0, "propagated"), *bursts)


def test_short_coasting_adds_up_unless_rtk_makes_up_for_it() -> None:
    paid = [f for k in range(10) for f in (*run(8.0 * k, 8.0 * k + 4.0), *run(8.0 * k + 4.0, 8.0 * k + 8.0, "propagated"))]
    assert judged(*paid).count(None) == 80
    unpaid = [f for k in range(10) for f in (*run(6.0 * k, 6.0 * k + 2.0), *run(6.0 * k + 2.0, 6.0 * k + 6.0, "propagated"))]
    assert judged(*unpaid).count(None) == 8


def test_a_fix_that_comes_late_or_twice_does_not_slip_past_the_doubt() -> None:
    coasted = run(0.0, 6.0, "propagated")
    proving = run(6.0, 9.0)
    assert judged(*coasted, *proving, proving[-1], proving[2])[-2:] == ["unproven", "unproven"]
    # and where it is late among those that are no fixes, it does not begin a proof in the past
    assert judged(*coasted, SeenFix(3.1, "rtk_fixed", 62.0, 1.0, 0.1)) == ["solution"] * 12 + ["unproven"]


def test_a_late_report_of_coasting_does_not_interrupt_a_proof() -> None:
    proof = judged(*run(0.0, 6.0, "propagated"), *run(6.0, 9.0), *run(5.0, 5.5, "propagated"), *run(9.0, 13.0))
    assert proof == ["solution"] * 12 + ["unproven"] * 6 + ["solution"] + ["unproven"] * 6 + [None] * 2


def test_silence_is_not_coasting_but_interrupts_a_proof() -> None:
    assert judged(*run(0.0, 2.0), *run(60.0, 62.0)) == [None] * 8
    proof = judged(*run(0.0, 6.0, "propagated"), *run(6.0, 10.0), *run(13.0, 20.0))
    assert proof == ["solution"] * 12 + ["unproven"] * 20 + [None] * 2


def test_a_jump_that_no_train_can_make_costs_the_credit_until_proved_again() -> None:
    told = judged(*run(0.0, 5.0), *run(5.0, 15.0, off_m=50.0))
    assert told[:10] == [None] * 10
    # 50 m in half a second; the speeds on both sides of it differ too
    assert told[10] == "jump"
    assert "unproven" in told[11:24]
    assert told[-4:] == [None] * 4
    # where the receiver gives its speed, the jump shows at once and only once
    sure = judged(*run(0.0, 5.0, speed_mps=20.0), *run(5.0, 15.0, off_m=50.0, speed_mps=20.0))
    assert sure == [None] * 10 + ["jump"] + ["unproven"] * 12 + [None] * 7


def test_braking_as_hard_as_trains_can_is_no_jump() -> None:
    fixes = [SeenFix(t, "rtk_fixed", 30.0 * t - 1.25 * t * t, 1.0, 0.01) for t in (0.4 * k for k in range(30))]
    assert set(judged(*fixes)) == {None}


def test_stand_alone_fixes_claim_little_and_are_not_asked_to_prove_anything() -> None:
    jumping = [f._replace(position_m=f.position_m + 30.0 * (-1) ** k) for k, f in enumerate(run(0.0, 10.0, "single"))]
    assert set(judged(*run(-10.0, 0.0, "propagated"), *jumping)) == {"solution", None}


@pytest.mark.parametrize(
    ("satellites", "refused", "factor"), [(3, "satellites", 1.0), (4, None, 2.0), (10, None, 2.0), (11, None, 1.0)]
)
def test_the_satellites_decide_on_a_stand_alone_fix_as_in_the_source(
    satellites: int, refused: str | None, factor: float
) -> None:
    (one,) = run(0.0, 0.5, "single", satellites=satellites)
    assert FixMonitor(FixLimits(), KNOWN).judge(one) == (refused, factor)
    (rtk,) = run(0.0, 0.5, satellites=satellites)
    assert FixMonitor(FixLimits(), KNOWN).judge(rtk) == (refused, 1.0)


@pytest.mark.parametrize(
    ("cross", "std", "refused"),
    [(9.9, 0.1, None), (10.1, 0.1, "off_track"), (39.0, 10.0, None), (41.0, 10.0, "off_track"), (math.nan, 0.1, "off_track")],
)
def test_the_distance_from_the_track_is_judged_by_the_limit_or_the_standard_deviation(
    cross: float, std: float, refused: str | None
) -> None:
    assert judged(SeenFix(0.0, "rtk_fixed", 0.0, cross, std)) == [refused]


@pytest.mark.parametrize(
    ("turned", "refused"), [(0.0, None), (19.0, None), (-161.0, None), (21.0, "off_course"), (90.0, "off_course")]
)
def test_a_course_across_the_track_is_not_this_trains(turned: float, refused: str | None) -> None:
    assert judged(SeenFix(0.0, "rtk_fixed", 0.0, 1.0, 0.1, None, 20.0, turned)) == [refused]


def test_an_observer_tells_once_that_credit_is_lost_and_once_that_it_is_back() -> None:
    observer = gnss().observer()
    told, counts = [], []
    for k in range(60):
        t = 0.5 * k
        solution = "propagated" if 5.0 <= t < 12.0 else "rtk_fixed"
        counts.append(len(observer.observe(fix(1000.0 + 20.0 * t, t, solution=solution), None)))
        told += [(t, notice.code) for notice in observer.notices()]
    assert told == [(9.5, "gnss_not_trusted"), (18.0, "gnss_trusted_again")]
    assert counts == [1] * 10 + [0] * 26 + [1] * 24


def test_after_a_restart_on_a_running_train_rtk_has_to_prove_itself_and_a_stand_alone_fix_has_not() -> None:
    again = gnss(position_std_m={"rtk_fixed": 0.1, "single": 3.0}, source="recording").observer()
    again.restarted()
    counts = [len(again.observe(fix(s=1000.0 + 10.0 * k, t_s=0.5 * k), None)) for k in range(16)]
    assert counts == [0] * 12 + [1] * 4
    again.restarted()
    assert len(again.observe(fix(s=1200.0, t_s=10.0, solution="single"), None)) == 1


def test_poor_sky_widens_the_figure_of_a_stand_alone_fix_but_not_a_stated_one() -> None:
    figures = {"position_std_m": {"single": 3.0}, "source": "recording"}
    poor = fix(solution="single", satellites=6, horizontal_std_m=4.0)
    assert gnss(**figures).observe(poor, None)[0].variance == pytest.approx(36.0)
    assert gnss(**figures, trust_stated_std=True).observe(poor, None)[0].variance == pytest.approx(16.0)


# real trains --------------------------------------------------------------------------------------------------------------


@pytest.mark.skipif(not DATA.is_dir(), reason="the recorded logs are not here")
@pytest.mark.parametrize(
    ("log", "least", "good"),
    [("28876", 1098, [(0.0, 453.0)]), ("28554", 240, [(0.0, 113.0)]), ("28573", 280, [(0.0, 110.0), (577.0, 616.0)])],
)
def test_on_real_trains_the_drifting_fixes_that_call_themselves_rtk_do_not_count(
    log: str, least: int, good: list[tuple[float, float]]
) -> None:
    """`good`: where RTK holds for long and lies on the track; between them the receiver coasts and RTK comes in bursts."""
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
