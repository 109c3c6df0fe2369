<<<<<<< .merge_file_eDPExN
"""The tests of a unit's innovations."""

from __future__ import annotations

import numpy as np
import pytest

from milepost.fusion.evidence import FULL, TESTS, Bounds, extended, statistics

H = 33


def sums_of(innovations):
    sums = np.zeros((len(TESTS), H))
=======
"""Tests of innovations: hand-computed sums, their distribution under white noise, and the threshold from one number."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
import pytest

from milepost.fusion.evidence import KINDS, SUMS, TESTS, WINDOWS, extended, normal_reach, statistics, threshold, window_of

RUNS = 20_000
# so many readings: the two shorter windows are full, the longest fills
COUNTS = (1, 8, 64, 300)
# a moderate threshold, which enough runs exceed
MODERATE = 2.5
TWO_SIDED = 2.0 * NormalDist().cdf(-MODERATE)
ONE_SIDED = NormalDist().cdf(-MODERATE)


def summed(innovations: np.ndarray) -> np.ndarray:
    """The sums after innovations (count, H)."""
    sums = np.zeros((innovations.shape[1], SUMS))
>>>>>>> .merge_file_7szVX9
    for e in innovations:
        sums = extended(sums, e)
    return sums


<<<<<<< .merge_file_eDPExN
@pytest.mark.parametrize("count", [1, 2, 9, 100, 700])
@pytest.mark.parametrize("limit", [1.5, 4.7, 5.9])
def test_bounds_on_sums_decide_as_the_tests_do(count, limit):
    rng = np.random.default_rng(count)
    scale = np.linspace(0.1, 6.0, H)
    sums = sums_of(scale * rng.normal(size=(count, H)) + 0.3 * scale)
    exceeded = statistics(sums, count) > limit
    assert exceeded.any()
    assert not exceeded.all()
    assert np.array_equal(Bounds(limit).exceeded(sums, count), exceeded)


def test_bounds_no_longer_change_beyond_the_longest_window():
    sums = np.full((len(TESTS), H), 40.0)
    assert np.array_equal(Bounds(5.0).exceeded(sums, FULL), Bounds(5.0).exceeded(sums, 100 * FULL))


def test_first_test_is_the_last_innovation_alone():
    last = np.linspace(-3.0, 3.0, H)
    sums = sums_of([np.full(H, 9.0), last])
    assert np.array_equal(statistics(sums, 2)[0], np.abs(last))
=======
def upper_bound(probability: float, runs: int) -> float:
    """The relative frequency that chance exceeds once in 30 000 times (normal approximation of the binomial)."""
    return probability + 4.0 * math.sqrt(probability * (1.0 - probability) / runs)


@pytest.fixture(scope="module", params=COUNTS)
def white(request: pytest.FixtureRequest) -> tuple[int, np.ndarray]:
    """The number of innovations, and the tests (RUNS, 7) after them, under white noise."""
    e = np.random.default_rng(20260).normal(size=(request.param, RUNS))
    return request.param, statistics(summed(e), e[-1], request.param)


@pytest.mark.parametrize("place", range(len(TESTS)), ids=lambda i: f"{KINDS[i]}-{window_of(i)}")
def test_white_noise_exceeds_a_limit_as_often_as_stated(white: tuple[int, np.ndarray], place: int) -> None:
    """A mean square is normal to third order only (Wilson and Hilferty): a fifth more is allowed, from 8 readings on."""
    count, tests = white
    often = float((tests[:, place] > MODERATE).mean())
    if KINDS[place] == "noisy":
        assert often < upper_bound(1.2 * ONE_SIDED, RUNS) if count >= 8 else often < upper_bound(2.0 * ONE_SIDED, RUNS)
    else:
        assert TWO_SIDED - (upper_bound(TWO_SIDED, RUNS) - TWO_SIDED) < often < upper_bound(TWO_SIDED, RUNS)


def test_the_sums_are_those_computed_by_hand() -> None:
    e = np.array([[1.0, -2.0], [0.5, 3.0], [2.0, 0.0]])
    sums = summed(e)
    for column, length in enumerate(WINDOWS):
        forget = 1.0 - 1.0 / length
        for row in range(2):
            a, b, c = e[:, row]
            assert sums[row, column] == pytest.approx(forget**2 * a + forget * b + c, rel=1e-14)
            assert sums[row, column + len(WINDOWS)] == pytest.approx(forget**2 * a * a + forget * b * b + c * c, rel=1e-14)


def test_the_tests_of_two_readings_are_those_computed_by_hand() -> None:
    e = np.array([[1.5], [-0.5]])
    tests = statistics(summed(e), e[-1], 2)[0]
    assert tests[0] == 0.5
    for place, length in enumerate(WINDOWS):
        forget = 1.0 - 1.0 / length
        weights, squares = 1.0 + forget, 1.0 + forget**2
        assert tests[1 + place] == pytest.approx(abs(-0.5 + forget * 1.5) / math.sqrt(squares), rel=1e-12)
        degrees = weights**2 / squares
        spread = 2.0 / (9.0 * degrees)
        mean_square = (0.25 + forget * 2.25) / weights
        expected = (mean_square ** (1.0 / 3.0) - 1.0 + spread) / math.sqrt(spread)
        assert tests[1 + len(WINDOWS) + place] == pytest.approx(expected, rel=1e-12)


def test_the_sums_of_each_hypothesis_are_its_own() -> None:
    e = np.random.default_rng(3).normal(size=(40, 5))
    together = statistics(summed(e), e[-1], 40)
    for row in range(5):
        alone = statistics(summed(e[:, [row]]), e[-1, [row]], 40)
        np.testing.assert_array_equal(together[[row]], alone)


def test_extending_leaves_the_former_sums_as_they_were() -> None:
    before = np.ones((2, SUMS))
    extended(before, np.array([5.0, 6.0]))
    np.testing.assert_array_equal(before, np.ones((2, SUMS)))


def test_a_bias_and_a_noise_are_told_apart() -> None:
    rng = np.random.default_rng(11)
    e = rng.normal(size=(64, 400))
    biased, noisy = e + 1.5, 3.0 * e
    assert {KINDS[i] for i in statistics(summed(biased), biased[-1], 64).argmax(axis=1)} == {"biased"}
    loud = [KINDS[i] for i in statistics(summed(noisy), noisy[-1], 64).argmax(axis=1)]
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
    sums, alarms = np.zeros((runs, SUMS)), 0
    for count, row in enumerate(e, start=1):
        sums = extended(sums, row)
        alarms += int((statistics(sums, row, count).max(axis=1) > k).sum())
    assert 0 < alarms / (readings * runs) < 0.02


def test_the_reach_has_the_risk_that_it_is_given() -> None:
    for risk in (0.05, 1e-4, 1e-9):
        assert 2.0 * NormalDist().cdf(-normal_reach(risk)) == pytest.approx(risk, rel=1e-6)
    assert normal_reach(3.0) == 1.0
    assert math.isfinite(normal_reach(0.0))
>>>>>>> .merge_file_7szVX9
