"""Simulated and recorded motion: exact between knots, seeded, bounded with a driver, recovered from noisy fixes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from milepost.estimation.motion import process_noise, transition
from milepost.recordings.gnss_log import RecordedFix
from milepost.simulation.motion import BLOCK_S, KnotMotion, Profile, WhiteJerkMotion, evaluate, quintics, when_at
from milepost.simulation.recorded_motion import smooth_motion
from milepost.track.track import Track

CRUISE = Profile([(0.0, 20.0)], 0.0)
coefficient = st.floats(-10.0, 10.0)


def white_jerk(seed: int = 1, end_s: float = 1000.0, driver_s: float | None = None, psd: float = 1e-6) -> WhiteJerkMotion:
    return WhiteJerkMotion(CRUISE, end_s, psd, driver_s, [0.02, 0.1, 0.01], seed)


def polynomial(c: list[float], t: float) -> list[float]:
    p = np.polynomial.Polynomial(c)
    return [float(p(t)), float(p.deriv(1)(t)), float(p.deriv(2)(t))]


@given(
    knots=st.lists(st.tuples(coefficient, coefficient, coefficient), min_size=2, max_size=6),
    steps=st.lists(st.floats(0.01, 5.0), min_size=5, max_size=5),
)
def test_a_motion_passes_through_its_knots(knots: list[tuple[float, float, float]], steps: list[float]) -> None:
    times = np.cumsum([0.0, *steps])[: len(knots)]
    motion = KnotMotion(times, np.array(knots))
    for t, knot in zip(times, knots, strict=True):
        assert motion.at(float(t)) == pytest.approx(knot, abs=1e-6)
        just_before = motion.at(math.nextafter(float(t), -1.0))
        assert just_before == pytest.approx(knot, abs=1e-6)


@given(c=st.lists(coefficient, min_size=6, max_size=6), dt=st.floats(0.1, 3.0), part=st.floats(0.0, 1.0))
def test_a_quintic_comes_back_exactly_from_its_ends(c: list[float], dt: float, part: float) -> None:
    rows = quintics(np.array([dt]), np.array([polynomial(c, 0.0), polynomial(c, dt)]))
    expected = polynomial(c, part * dt)
    size = max(abs(x) for x in [*polynomial([abs(k) for k in c], dt), 1.0])
    assert evaluate(rows[0], part * dt) == pytest.approx(expected, abs=1e-9 * size)


def test_speed_and_acceleration_are_the_derivatives_of_position() -> None:
    motion, h = white_jerk(psd=1e-2), 1e-4
    for t in np.random.default_rng(0).uniform(0.01, 99.0, 50):
        (s0, v0, _), (_, v, a), (s1, v1, _) = motion.at(t - h), motion.at(t), motion.at(t + h)
        assert v == pytest.approx((s1 - s0) / (2 * h), abs=1e-5)
        assert a == pytest.approx((v1 - v0) / (2 * h), abs=1e-3)


def test_beyond_its_knots_a_motion_stays_where_it_was() -> None:
    motion = KnotMotion(np.array([1.0, 2.0]), np.array([[5.0, 1.0, 0.0], [6.0, 1.0, 0.0]]))
    assert motion.at(0.0) == pytest.approx((5.0, 1.0, 0.0))
    assert motion.at(9.0) == pytest.approx((6.0, 1.0, 0.0))
    assert motion.end_s == 2.0


@pytest.mark.parametrize("driver_s", [None, 60.0])
def test_a_seed_gives_one_motion_in_any_order_of_calls(driver_s: float | None) -> None:
    times = np.random.default_rng(3).uniform(0.0, 12 * BLOCK_S, 60)
    forward, backward, shuffled = (white_jerk(driver_s=driver_s) for _ in range(3))
    expected = {t: forward.at(t) for t in sorted(times)}
    assert {t: backward.at(t) for t in sorted(times, reverse=True)} == expected
    assert {t: shuffled.at(t) for t in times} == expected
    # and again, after its blocks were dropped and made anew
    assert {t: shuffled.at(t) for t in times} == expected
    # and in a process that begins in the middle
    late = max(times)
    assert white_jerk(driver_s=driver_s).at(late) == expected[late]


def test_other_seeds_give_other_motions_from_the_start() -> None:
    starts = {white_jerk(seed).at(0.0) for seed in range(20)}
    middles = {white_jerk(seed).at(5.0)[2] - white_jerk(seed).at(0.0)[2] for seed in range(20)}
    assert len(starts) == len(middles) == 20


@pytest.mark.parametrize("driver_s", [None, 60.0])
def test_a_motion_is_smooth_where_its_blocks_meet(driver_s: float | None) -> None:
    motion = white_jerk(driver_s=driver_s)
    for block in (1, 2, 7):
        t = block * BLOCK_S
        s, v, a = motion.at(math.nextafter(t, 0.0))
        assert motion.at(t) == pytest.approx((s, v, a), abs=1e-9)


def increments(dt_s: float, count: int, psd: float) -> NDArray[np.float64]:
    """What white jerk added in each of `count` steps: d(t + dt) - F(dt) d(t), d the deviation from the profile."""
    motion = white_jerk(seed=5, end_s=dt_s * count, psd=psd)
    d = np.array([np.array(motion.at(k * dt_s)) - CRUISE.at(k * dt_s) for k in range(count + 1)])
    return d[1:] - d[:-1] @ transition(dt_s).T


@pytest.mark.parametrize(("dt_s", "count"), [(0.01, 4000), (0.1, 2000), (1.0, 800)])
def test_a_steps_noise_has_the_covariance_of_the_motion_model(dt_s: float, count: int) -> None:
    # a large density, so that the numbers stand out from rounding at a position of kilometres
    psd = 1.0
    w = increments(dt_s, count, psd)
    whitened = np.linalg.solve(np.linalg.cholesky(process_noise(dt_s, psd)), w.T)
    covariance = whitened @ whitened.T / count
    # five standard deviations of a sample covariance of independent standard normals
    assert np.abs(np.diag(covariance) - 1.0).max() < 5.0 * math.sqrt(2.0 / count)
    assert np.abs(covariance - np.diag(np.diag(covariance))).max() < 5.0 / math.sqrt(count)
    assert np.abs(whitened.mean(axis=1)).max() < 5.0 / math.sqrt(count)
    # white: one step tells nothing of the next
    lagged = whitened[:, 1:] @ whitened[:, :-1].T / (count - 1)
    assert np.abs(lagged).max() < 5.0 / math.sqrt(count)


def test_the_start_is_spread_as_asked() -> None:
    starts = np.array([white_jerk(seed).at(0.0) for seed in range(200)]) - np.array([0.0, 20.0, 0.0])
    std = starts.std(axis=0)
    assert std == pytest.approx([0.02, 0.1, 0.01], rel=5.0 / math.sqrt(2 * 200))


def stationary_std(driver_s: float, psd: float) -> NDArray[np.float64]:
    """Standard deviations of the steered deviation after a long time: A P + P Aᵀ + Q = 0."""
    k = 1.0 / driver_s
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-(k**3), -3 * k**2, -3 * k]])
    Q = np.diag([0.0, 0.0, psd])
    P = np.linalg.solve(np.kron(A, np.eye(3)) + np.kron(np.eye(3), A), -Q.ravel()).reshape(3, 3)
    return np.sqrt(np.diag(P))


@pytest.mark.slow
def test_a_driver_keeps_an_hour_bounded_as_theory_says() -> None:
    motion = white_jerk(1, end_s=3600.0, driver_s=60.0)
    times = np.arange(600.0, 3600.0, 5.0)
    deviations = np.array([np.array(motion.at(t)) - CRUISE.at(t) for t in times])
    bound = stationary_std(60.0, 1e-6)
    assert (np.abs(deviations).max(axis=0) < 5.0 * bound).all()
    # not by standing still: the deviations are of the size that theory gives
    assert (np.abs(deviations).max(axis=0) > 0.5 * bound).all()


def test_without_jerk_and_spread_a_motion_is_its_profile() -> None:
    profile = Profile([(0.0, 0.0), (10.0, 20.0), (30.0, 20.0), (40.0, 5.0)], 100.0)
    motion = WhiteJerkMotion(profile, 60.0, 0.0, None, [0.0] * 3, 1)
    for t in np.arange(0.005, 55.0, 0.37):
        # acceleration turns within the 10 ms before a corner
        assert motion.at(t)[:2] == pytest.approx(profile.at(t)[:2], abs=0.02)
        assert motion.at(round(t, 2)) == pytest.approx(profile.at(round(t, 2)), abs=1e-9)


def test_a_profiles_position_is_the_integral_of_its_speed() -> None:
    profile = Profile([(0.0, 0.0), (10.0, 20.0), (20.0, 10.0)], 50.0)
    assert profile.at(0.0) == (50.0, 0.0, 2.0)
    assert profile.at(5.0) == (50.0 + 25.0, 10.0, 2.0)
    assert profile.at(10.0) == (150.0, 20.0, -1.0)
    assert profile.at(20.0) == (300.0, 10.0, 0.0)
    assert profile.at(30.0) == (400.0, 10.0, 0.0)


@given(position=st.floats(51.0, 5000.0))
def test_a_profile_reaches_a_position_when_it_is_there(position: float) -> None:
    profile = Profile([(0.0, 1.0), (10.0, 20.0), (20.0, 10.0)], 50.0)
    assert profile.at(profile.reaches(position))[0] == pytest.approx(position, abs=1e-6)


def test_a_profile_that_stops_never_reaches_what_lies_beyond() -> None:
    assert Profile([(0.0, 10.0), (10.0, 0.0)], 0.0).reaches(51.0) == math.inf


def test_a_rounded_corner_changes_the_acceleration_evenly() -> None:
    """From rest to 1 m/s² at 10 s, rounded over 4 s: at 10 s half of it, at 12 s all; s and v are each other's integrals.

    At 12 s the average over [10, 14] of the sharp speed t - 10 is 2 m/s; the sharp train stands at 50 m until then.
    """
    profile = Profile([(0.0, 0.0), (10.0, 0.0), (30.0, 20.0)], 50.0, corner_s=4.0)
    assert profile.at(0.0) == (50.0, 0.0, 0.0)
    assert profile.at(10.0)[2] == pytest.approx(0.5)
    assert profile.at(12.0)[1:] == pytest.approx((2.0, 1.0))
    for t in np.arange(1.0, 35.0, 1.7):
        (s0, v0, _), (s1, v1, _) = profile.at(t - 1e-3), profile.at(t + 1e-3)
        _, v, a = profile.at(t)
        assert (s1 - s0) / 2e-3 == pytest.approx(v, abs=1e-5)
        assert (v1 - v0) / 2e-3 == pytest.approx(a, abs=1e-3)


@given(position=st.floats(0.5, 180.0))
def test_the_passage_of_a_position_is_when_the_train_is_there(position: float) -> None:
    motion = white_jerk(psd=0.01)
    at = when_at(motion, position, 0.0, 20.0)
    assert at is not None
    assert 0.0 <= at <= 20.0
    assert motion.at(at)[0] == pytest.approx(position, abs=1e-8)


def test_a_passage_outside_the_span_is_none() -> None:
    motion = WhiteJerkMotion(CRUISE, 100.0, 0.0, None, [0.0] * 3, 1)
    assert when_at(motion, 50.0, 0.0, 2.4) is None
    assert when_at(motion, 50.0, 2.6, 5.0) is None
    assert when_at(motion, 50.0, 2.4, 2.6) == pytest.approx(2.5, abs=1e-9)


def test_a_passage_after_standing_still_is_found() -> None:
    motion = WhiteJerkMotion(Profile([(0.0, 0.0), (50.0, 0.0), (60.0, 10.0)], 0.0), 100.0, 0.0, None, [0.0] * 3, 1)
    at = when_at(motion, 20.0, 0.0, 60.0)
    assert at is not None
    assert motion.at(at)[0] == pytest.approx(20.0, abs=1e-8)


LOG = Path("log.csv")
TRACK = Track([(4.5 + 0.002 * i, 50.9 + 0.0002 * i) for i in range(40)])


def noisy_fixes(motion: KnotMotion, std_m: float, skip: tuple[float, float] = (0.0, 0.0)) -> list[RecordedFix]:
    rng = np.random.default_rng(11)
    fixes = []
    for t in np.arange(0.0, motion.end_s, 0.4):
        lat, lon = TRACK.locate(motion.at(t)[0] + std_m * rng.standard_normal())
        if not skip[0] <= t < skip[1]:
            fixes.append(RecordedFix(round(float(t), 3), lat, lon, "rtk_fixed"))
    return fixes


def known_motion() -> KnotMotion:
    times = np.arange(0.0, 121.0, 1.0)
    w = 0.05
    knots = np.column_stack(
        [200.0 + 15.0 * times + 60.0 * np.sin(w * times), 15.0 + 3.0 * np.cos(w * times), -0.15 * np.sin(w * times)]
    )
    return KnotMotion(times, knots)


def position_rms(a: KnotMotion, b: KnotMotion, times: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean([(a.at(t)[0] - b.at(t)[0]) ** 2 for t in times])))


def test_smoothing_recovers_a_known_motion_better_than_the_fixes_themselves() -> None:
    truth, std = known_motion(), 0.5
    smooth = smooth_motion(LOG, noisy_fixes(truth, std), TRACK, std, 1e-3)
    between = np.arange(0.2, 119.0, 0.4)
    assert position_rms(smooth, truth, between) < 0.5 * std
    # what a difference of neighbouring fixes would give: √2 · 0.5 / 0.4 = 1.8 m/s
    speed = np.array([smooth.at(t)[1] - truth.at(t)[1] for t in between])
    assert np.sqrt(np.mean(speed**2)) < 0.2


def test_smoothing_is_more_accurate_than_filtering() -> None:
    """The first fixes have only a future: a filter would leave their full error there."""
    truth, std = known_motion(), 0.5
    smooth = smooth_motion(LOG, noisy_fixes(truth, std), TRACK, std, 1e-3)
    assert position_rms(smooth, truth, np.arange(0.0, 4.0, 0.4)) < 0.8 * std


def test_a_gap_in_the_fixes_is_bridged_from_both_of_its_ends() -> None:
    truth = known_motion()
    smooth = smooth_motion(LOG, noisy_fixes(truth, 0.02, skip=(50.0, 60.0)), TRACK, 0.02, 1e-3)
    assert position_rms(smooth, truth, np.arange(50.0, 60.0, 0.1)) < 0.5
    assert smooth.at(55.0)[1] == pytest.approx(truth.at(55.0)[1], abs=0.2)


def test_only_trusted_fixes_are_used_and_time_starts_at_zero() -> None:
    truth = known_motion()
    fixes = noisy_fixes(truth, 0.02)
    wild = [RecordedFix(f.t_s, f.latitude_deg, f.longitude_deg + 0.01, "single") for f in fixes[:25]] + fixes[25:]
    smooth = smooth_motion(LOG, wild, TRACK, 0.02, 1e-3)
    assert smooth.at(20.0)[0] == pytest.approx(truth.at(20.0)[0], abs=0.2)
    assert smooth.at(0.0)[0] == pytest.approx(truth.at(0.0)[0], abs=15.0)
    assert smooth.at(0.0)[0] < smooth.at(5.0)[0] < smooth.at(10.0)[0]


def test_three_trusted_fixes_are_too_few() -> None:
    with pytest.raises(ValueError, match="four"):
        smooth_motion(LOG, noisy_fixes(known_motion(), 0.1)[:3], TRACK, 0.1, 1e-3)
