"""The Kalman filter's steps for many beliefs at once."""

from __future__ import annotations

import numpy as np
import pytest

from milepost.estimation import kalman
from milepost.estimation.beliefs import joined
from milepost.estimation.gaussian import stretched
from milepost.estimation.stack import KEPT_SHAPES, WELL_WITHIN, Linear, Stack, Step

H, N, R = 7, 5, 0.3


@pytest.fixture
def beliefs():
    rng = np.random.default_rng(4)
    root = rng.normal(size=(H, N, N))
    return rng.normal(size=(H, N)), root @ root.transpose(0, 2, 1) + np.eye(N)


def apart(B):
    """The means and covariances in one array; each is there twice, alike."""
    np.testing.assert_array_equal(B[-1, :-1], B[:-1, -1])
    np.testing.assert_allclose(B, B.transpose(1, 0, 2), rtol=1e-14)
    assert not B[-1, -1].any()
    return B[:-1, -1].T, B[:-1, :-1].transpose(2, 0, 1)


def row(each, z=1.5, R=R):
    """A row of all beliefs, or of each over three of the states; and as the filter takes it, one for each."""
    rng = np.random.default_rng(5)
    if not each:
        h = rng.normal(size=N)
        return Linear(np.append(h, 0.0), z, R), [h] * H
    places, h = np.array([0, 2, 4]), rng.normal(size=(3, H))
    full = np.zeros((H, N))
    full[:, places] = h.T
    return Linear(h, z, R, None, places), full


def moved(F, Q):
    """A step whose motion is given."""
    n = len(F)
    big, noise = np.eye(n + 1), np.zeros((n + 1, n + 1, 1))
    big[:n, :n], noise[:n, :n, 0] = F, Q
    return Step(big, noise, np.zeros((3, 3, 1)))


@pytest.mark.parametrize("scale", [None, 4])
@pytest.mark.parametrize("each", [False, True])
def test_update_is_the_filter_s_for_each_belief(beliefs, each, scale):
    (x, P), stack, (linear, h) = beliefs, Stack(), row(each)
    B, taken = joined(x, P), np.arange(H) != 2
    x_new, P_new = apart(stack.update(B, linear, stack.innovations(B, linear), taken, scale))
    for i in range(H):
        mean, covariance = kalman.update(x[i], P[i], h[i], 1.5, R) if taken[i] else (x[i], P[i])
        if scale is not None:
            covariance = stretched(x[i], mean, covariance, scale)
        np.testing.assert_allclose(x_new[i], mean, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(P_new[i], covariance, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("each", [False, True])
def test_innovations_are_those_of_each_belief(beliefs, each):
    (x, P), (linear, h) = beliefs, row(each)
    g, S, root, nu = Stack().innovations(joined(x, P), linear)
    for i in range(H):
        np.testing.assert_allclose(g[:, i], [*(P[i] @ h[i]), -nu[i]], rtol=1e-12)
        assert (S[i], nu[i]) == pytest.approx((h[i] @ P[i] @ h[i] + R, 1.5 - h[i] @ x[i]))
    np.testing.assert_array_equal(root, np.sqrt(S))


@pytest.mark.parametrize("ratio", [1.0, 0.9 * WELL_WITHIN, 1.1 * WELL_WITHIN, 1e8, 1e12])
@pytest.mark.parametrize("each", [False, True])
def test_update_keeps_what_is_left_of_the_variance_however_much_it_takes_away(beliefs, each, ratio):
    (x, P), stack = beliefs, Stack()
    B, noise = joined(x, P), P[:, 1, 1] / ratio
    alone = Linear(np.ones((1, H)), 1.5, noise, None, np.array([1])) if each else Linear(np.eye(N + 1)[1], 1.5, noise)
    _, P_new = apart(stack.update(B, alone, stack.innovations(B, alone), np.ones(H, dtype=bool), None))
    # by hand: 1/(1/P₁₁ + 1/R)
    np.testing.assert_allclose(P_new[:, 1, 1], 1.0 / (1.0 / P[:, 1, 1] + 1.0 / noise), rtol=2e-15 * WELL_WITHIN)
    assert (np.linalg.eigvalsh(P_new)[:, 0] > 0.0).all()


def test_prediction_is_the_filter_s_for_each_belief(beliefs):
    x, P = beliefs
    F, Q = np.eye(N) + np.diag([0.1] * (N - 1), 1), 0.01 * np.eye(N)
    B = Stack().predict(joined(x, P), moved(F, Q))
    np.testing.assert_array_equal(B, B.transpose(1, 0, 2))
    x_new, P_new = apart(B)
    for i in range(H):
        mean, covariance = kalman.predict(x[i], P[i], F, Q)
        np.testing.assert_allclose(x_new[i], mean, rtol=1e-12)
        np.testing.assert_allclose(P_new[i], covariance, rtol=1e-12)


def test_later_steps_leave_earlier_results_alone(beliefs):
    B, (linear, _), stack, step = joined(*beliefs), row(True), Stack(), moved(np.eye(N), np.eye(N))
    everyone = np.ones(H, dtype=bool)
    results = [stack.predict(B, step), stack.update(B, linear, stack.innovations(B, linear), everyone, 4)]
    before = [result.copy() for result in results]
    later = stack.predict(results[1], step)
    stack.update(later, linear, stack.innovations(later, linear), everyone, 4)
    for now, then in zip(results, before, strict=True):
        assert np.array_equal(now, then)


def test_banks_of_many_sizes_do_not_keep_memory_for_each():
    stack = Stack()
    for size in range(1, 50):
        B = joined(np.zeros((size, N)), np.tile(np.eye(N), (size, 1, 1)))
        stack.predict(B, moved(np.eye(N), np.eye(N)))
    assert len(stack._kept) <= KEPT_SHAPES
