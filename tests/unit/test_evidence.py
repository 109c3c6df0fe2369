"""Tests of innovations: hand-computed sums, their distribution under white noise, and the threshold from one number."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
import pytest

from milepost.fusion.evidence import (
    FULL,
    KINDS,
    TESTS,
    WINDOWS,
    Bounds,
    extended,
    normal_reach,
    statistics,
    threshold,
    window_of,
    worst_by_chance,
)

RUNS = 20_000
# so many readings: the two shorter windows are full, the longest fills
COUNTS = (1, 8, 64, 300)
# a moderate threshold, which enough runs exceed
MODERATE = 2.5
TWO_SIDED = 2.0 * NormalDist().cdf(-MODERATE)
ONE_SIDED = NormalDist().cdf(-MODERATE)


def summed(innovations: np.ndarray) -> np.ndarray:
    """The sums after innovations (count, H)."""
    sums = np.zeros((len(TESTS), innovations.shape[1]))
    for e in innovations:
        sums = extended(sums, e)
    return sums


def upper_bound(probability: float, runs: int) -> float:
    """The relative frequency that chance exceeds once in 30 000 times (normal approximation of the binomial)."""
    return probability + 4.0 * math.sqrt(probability * (1.0 - probability) / runs)


@pytest.fixture(scope="module", params=COUNTS)
def white(request: pytest.FixtureRequest) -> tuple[int, np.ndarray]:
    """The number of innovations, and the tests (7, RUNS) after them, under white noise."""
    e = np.random.default_rng(20260).normal(size=(request.param, RUNS))
    return request.param, statistics(summed(e), request.param)


@pytest.mark.parametrize("place", range(len(TESTS)), ids=lambda i: f"{KINDS[i]}-{window_of(i)}")
def test_white_noise_exceeds_a_limit_as_often_as_stated(white: tuple[int, np.ndarray], place: int) -> None:
    """A mean square is normal to third order only (Wilson and Hilferty): a fifth more is allowed, from 8 readings on."""
    count, tests = white
    often = float((tests[place] > MODERATE).mean())
    if KINDS[place] == "noisy":
        assert often < upper_bound(1.2 * ONE_SIDED, RUNS) if count >= 8 else often < upper_bound(2.0 * ONE_SIDED, RUNS)
    else:
        assert TWO_SIDED - (upper_bound(TWO_SIDED, RUNS) - TWO_SIDED) < often < upper_bound(TWO_SIDED, RUNS)


def power(place: int) -> int:
    """1 for the tests of a mean, 2 for those of a mean square."""
    return 2 if KINDS[place] == "noisy" else 1


def test_the_sums_are_those_computed_by_hand() -> None:
    e = np.array([[1.0, -2.0], [0.5, 3.0], [2.0, 0.0]])
    sums = summed(e)
    for place, length in enumerate(WINDOWS):
        forget = 1.0 - 1.0 / length
        for row in range(2):
            a, b, c = e[:, row] ** power(place)
            assert sums[place, row] == pytest.approx(forget**2 * a + forget * b + c, rel=1e-14)


def test_the_tests_of_two_readings_are_those_computed_by_hand() -> None:
    tests = statistics(summed(np.array([[1.5], [-0.5]])), 2)[:, 0]
    for place, length in enumerate(WINDOWS):
        forget = 1.0 - 1.0 / length
        weights, squares = 1.0 + forget, 1.0 + forget**2
        expected = abs(-0.5 + forget * 1.5) / math.sqrt(squares)
        if power(place) == 2:
            spread = 2.0 / 9.0 * squares / weights**2
            mean_square = (0.25 + forget * 2.25) / weights
            expected = (mean_square ** (1.0 / 3.0) - 1.0 + spread) / math.sqrt(spread)
        assert tests[place] == pytest.approx(expected, rel=1e-12)


def test_the_first_test_is_of_the_last_innovation_alone() -> None:
    last = np.linspace(-3.0, 3.0, 5)
    np.testing.assert_array_equal(statistics(summed(np.stack([np.full(5, 9.0), last])), 2)[0], np.abs(last))


def test_the_sums_of_each_hypothesis_are_its_own() -> None:
    e = np.random.default_rng(3).normal(size=(40, 5))
    together = statistics(summed(e), 40)
    for row in range(5):
        np.testing.assert_array_equal(together[:, [row]], statistics(summed(e[:, [row]]), 40))


def test_extending_leaves_the_former_sums_as_they_were() -> None:
    before = np.ones((len(TESTS), 2))
    extended(before, np.array([5.0, 6.0]))
    np.testing.assert_array_equal(before, np.ones((len(TESTS), 2)))


def test_a_bias_and_a_noise_are_told_apart() -> None:
    rng = np.random.default_rng(11)
    e = rng.normal(size=(64, 400))
    biased, noisy = e + 1.5, 3.0 * e
    assert {KINDS[i] for i in statistics(summed(biased), 64).argmax(axis=0)} == {"biased"}
    loud = [KINDS[i] for i in statistics(summed(noisy), 64).argmax(axis=0)]
    assert loud.count("noisy") > 395


@pytest.mark.parametrize(("per_hour", "readings_per_s"), [(0.01, 100.0), (1.0, 40.0), (0.1, 0.5)])
def test_the_threshold_spends_the_budget_evenly_over_all_tests(per_hour: float, readings_per_s: float) -> None:
    k = threshold(per_hour, readings_per_s)
    alarms = 2.0 * NormalDist().cdf(-k) * 3600.0 * readings_per_s * len(TESTS)
    assert alarms == pytest.approx(per_hour, rel=1e-6)


def test_the_threshold_of_the_default_budget_is_the_one_by_hand() -> None:
    """0.01 an hour over 3600 · 100 · 7 tests: 2 Φ(-k) = 3.968e-9, k = 5.89."""
    assert threshold(0.01, 100.0) == pytest.approx(5.886, abs=0.005)


def test_the_threshold_is_finite_for_a_train_that_says_nothing() -> None:
    assert 0.0 < threshold(1e6, 0.0) < threshold(0.01, 0.0) < 7.0


def test_the_train_is_told_wrong_no_more_often_than_configured() -> None:
    """A moderate budget, so that chance can be counted: every test of every reading at the threshold that it asks for."""
    readings, runs, per_s = 400, 400, 10.0
    k = threshold(3600.0 * per_s * 0.02, per_s)  # one false alarm in 50 readings at most
    e = np.random.default_rng(8).normal(size=(readings, runs))
    sums, alarms = np.zeros((len(TESTS), runs)), 0
    for count, row in enumerate(e, start=1):
        sums = extended(sums, row)
        alarms += int((statistics(sums, count).max(axis=0) > k).sum())
    assert 0 < alarms / (readings * runs) < 0.02


def test_the_reach_has_the_risk_that_it_is_given() -> None:
    for risk in (0.05, 1e-4, 1e-9):
        assert 2.0 * NormalDist().cdf(-normal_reach(risk)) == pytest.approx(risk, rel=1e-6)
    assert normal_reach(3.0) == 1.0
    assert math.isfinite(normal_reach(0.0))


@pytest.mark.parametrize("count", [1, 2, 9, 100, 700])
@pytest.mark.parametrize("limit", [1.5, 4.7, 5.9])
def test_bounds_on_sums_decide_as_the_tests_do(count: int, limit: float) -> None:
    scale = np.linspace(0.1, 6.0, 33)
    sums = summed(scale * np.random.default_rng(count).normal(size=(count, 33)) + 0.3 * scale)
    exceeded = statistics(sums, count) > limit
    assert exceeded.any()
    assert not exceeded.all()
    assert np.array_equal(Bounds(limit).exceeded(sums, count), exceeded)


def test_bounds_no_longer_change_beyond_the_longest_window() -> None:
    sums = np.full((len(TESTS), 3), 40.0)
    assert np.array_equal(Bounds(5.0).exceeded(sums, FULL), Bounds(5.0).exceeded(sums, 100 * FULL))


def test_the_first_test_is_the_last_innovation_alone() -> None:
    last = np.linspace(-3.0, 3.0, 33)
    assert np.array_equal(statistics(summed(np.array([np.full(33, 9.0), last])), 2)[0], np.abs(last))


def test_the_worst_of_several_tests_is_as_bad_by_chance_more_often_than_one() -> None:
    """By hand: 1.96 σ happen to one test in 0.05 of all cases, to one of two in 1 - 0.95² = 0.0975; without a test all fits."""
    worst, tests = np.array([1.959964, 1.959964, 0.0, 1.959964, 5.0]), np.array([1.0, 2.0, 3.0, 0.0, 18.0])
    often = worst_by_chance(worst, tests)
    assert often == pytest.approx([0.05, 0.0975, 1.0, 1.0, 18 * 5.733e-7], rel=1e-3)
    runs = np.abs(np.random.default_rng(5).normal(size=(18, RUNS))).max(axis=0)
    assert np.mean(worst_by_chance(runs, np.full(RUNS, 18.0)) < 0.1) == pytest.approx(0.1, abs=0.01)
