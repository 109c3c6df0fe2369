"""The Kalman filter's steps for many beliefs at once."""

from __future__ import annotations

import numpy as np
import pytest

from milepost.estimation import kalman
from milepost.estimation.gaussian import stretched
from milepost.fusion.stack import KEPT_SHAPES, WELL_WITHIN, Stack

H, N, R = 7, 5, 0.3


@pytest.fixture
def beliefs():
    rng = np.random.default_rng(4)
    root = rng.normal(size=(H, N, N))
    return rng.normal(size=(H, N)), root @ root.transpose(0, 2, 1) + np.eye(N)


def rows(each):
    rng = np.random.default_rng(5)
    return rng.normal(size=(H, N) if each else N)


@pytest.mark.parametrize("scale", [None, 4])
@pytest.mark.parametrize("each", [False, True])
def test_update_is_the_filter_s_for_each_belief(beliefs, each, scale):
    x, P = beliefs
    h, stack = rows(each), Stack()
    taken = np.arange(H) != 2
    x_new, P_new = stack.update(x, P, h, R, stack.innovations(x, P, h, 1.5, R), taken, scale)
    for i in range(H):
        mean, covariance = kalman.update(x[i], P[i], h[i] if each else h, 1.5, R) if taken[i] else (x[i], P[i])
        if scale is not None:
            covariance = stretched(x[i], mean, covariance, scale)
        np.testing.assert_allclose(x_new[i], mean, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(P_new[i], covariance, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("ratio", [1.0, 0.9 * WELL_WITHIN, 1.1 * WELL_WITHIN, 1e8, 1e12])
@pytest.mark.parametrize("each", [False, True])
def test_update_keeps_what_is_left_of_the_variance_however_much_it_takes_away(beliefs, each, ratio):
    x, P = beliefs
    h, stack = np.tile(np.eye(N)[1], (H, 1)) if each else np.eye(N)[1], Stack()
    noise = P[:, 1, 1] / ratio
    _, P_new = stack.update(x, P, h, noise, stack.innovations(x, P, h, 1.5, noise), np.ones(H, dtype=bool), None)
    # by hand: 1/(1/P₁₁ + 1/R)
    np.testing.assert_allclose(P_new[:, 1, 1], 1.0 / (1.0 / P[:, 1, 1] + 1.0 / noise), rtol=2e-15 * WELL_WITHIN)
    assert (np.linalg.eigvalsh(P_new)[:, 0] > 0.0).all()


def test_prediction_is_the_filter_s_for_each_belief(beliefs):
    x, P = beliefs
    F, Q = np.eye(N) + np.diag([0.1] * (N - 1), 1), 0.01 * np.eye(N)
    x_new, P_new = Stack().predict(x, P, F, Q)
    for i in range(H):
        mean, covariance = kalman.predict(x[i], P[i], F, Q)
        np.testing.assert_allclose(x_new[i], mean, rtol=1e-12)
        np.testing.assert_allclose(P_new[i], covariance, rtol=1e-12)


def test_later_steps_leave_earlier_results_alone(beliefs):
    x, P = beliefs
    h, stack, F = rows(True), Stack(), np.eye(N)
    everyone = np.ones(H, dtype=bool)
    results = [stack.predict(x, P, F, F), stack.update(x, P, h, R, stack.innovations(x, P, h, 1.5, R), everyone, 4)]
    before = [(mean.copy(), covariance.copy()) for mean, covariance in results]
    mean, covariance = stack.predict(*results[1], F, F)
    stack.update(mean, covariance, h, R, stack.innovations(mean, covariance, h, 0.0, R), everyone, 4)
    for now, then in zip(results, before, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(now, then, strict=True))


def test_banks_of_many_sizes_do_not_keep_memory_for_each():
    stack = Stack()
    for size in range(1, 50):
        stack.predict(np.zeros((size, N)), np.tile(np.eye(N), (size, 1, 1)), np.eye(N), np.eye(N))
    assert len(stack._kept) <= KEPT_SHAPES
