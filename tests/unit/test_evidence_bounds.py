"""The tests of a unit's innovations."""

from __future__ import annotations

import numpy as np
import pytest

from milepost.fusion.evidence import FULL, TESTS, Bounds, extended, statistics

H = 33


def sums_of(innovations):
    sums = np.zeros((len(TESTS), H))
    for e in innovations:
        sums = extended(sums, e)
    return sums


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
